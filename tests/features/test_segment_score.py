"""The compiled score against one written out in NumPy."""

import numpy as np
import pytest

from lcdata.features.cloud_attributes import cloud_attributes, direction_vectors
from lcdata.features.nid_views import BLOCKS
from lcdata.features.segment_layers import layers_of_image
from lcdata.features.segment_objective import (
    Prior,
    SegmentFeatures,
    SegmentObjective,
    count,
    objective,
)
from lcdata.geometry import se3
from tests.segment_scene import patch_pair


@pytest.fixture(scope="module")
def scene():
    pair = patch_pair(5, points=3000)
    layers = layers_of_image(pair.image, pair.camera, (60.0, 150.0))
    features = SegmentFeatures(layers, cloud_attributes(pair.points, pair.intensity))
    return pair, objective([features], pair.T_camera_lidar, 0.1, "explained")


def statistics(directions, light, classes):
    """Consistency of points as published, one pair of normals after the other."""
    vectors = direction_vectors()[directions]
    agreement = np.abs(vectors @ vectors.T).mean()
    shares = np.sort(np.bincount(classes[classes < 64], minlength=1))[::-1] / max(
        (classes < 64).sum(), 1
    )
    return np.array([agreement, 1 - light.std(), (shares * 0.5 ** np.arange(len(shares))).sum()])


def brute_force(view, T):
    """Mean consistencies of all masks, and those of their points as one."""
    pixels, inside = view.layers.camera.project(se3.apply(T, view.points.astype(float)))
    column, row = np.rint(pixels[inside]).astype(int).T
    index = np.flatnonzero(inside)
    labels = view.layers.labels[row, column]
    sums, weights, members = np.zeros(3), np.zeros(3), []
    for mask in range(1, view.layers.masks + 1):
        own = index[(labels == mask).any(axis=1)]
        if len(own) < max(view.fewest[mask], 1):
            continue
        members.append(own)
        n = np.array([len(own), len(own), (view.classes[own] < 64).sum()])
        sums += n * statistics(view.directions[own], view.light[own], view.classes[own])
        weights += n
    every = np.concatenate(members)
    pooled = statistics(view.directions[every], view.light[every], view.classes[every])
    return sums / weights, pooled, inside.sum()


@pytest.mark.parametrize("off", [np.zeros(6), [0.1, -0.05, 0.2, 0.02, -0.03, 0.01]])
def test_consistency_is_that_of_a_plain_computation(scene, off):
    pair, cost = scene
    T = se3.exp(off) @ pair.T_camera_lidar
    mean, pooled, inside = brute_force(cost.views[0], T)
    sums, found_pooled, seen = count(cost.views[0], T[None], 1)
    assert seen[0] == inside
    assert np.allclose(sums[0, 0, :3] / sums[0, 0, 3:], mean, atol=1e-5)
    assert np.allclose(found_pooled[0], pooled, atol=1e-5)
    published = SegmentObjective(cost.views, "published").hard(T[None])[0]
    assert np.isclose(published, 1 - mean @ [0.3, 0.2, 0.5], atol=1e-5)
    assert np.isclose(cost.hard(T[None])[0], (1 - mean) / (1 - pooled) @ [0.25, 0.5, 0.25])


def test_the_true_pose_is_the_most_consistent(scene):
    pair, cost = scene
    rng = np.random.default_rng(0)
    away = [
        se3.exp(rng.choice([-1, 1], 6) * np.repeat([0.03, np.deg2rad(1)], 3)) for _ in range(50)
    ]
    costs = cost.hard(np.array([np.eye(4), *away]) @ pair.T_camera_lidar)
    assert costs[0] < costs[1:].min()


def test_parts_of_the_image_add_up_to_the_change_of_the_cost(scene):
    pair, cost = scene
    T = pair.T_camera_lidar
    near = np.array([se3.exp(s * np.repeat([0.0005, 0.0005], 3)) @ T for s in (-1, 1)])
    (view,) = cost.views
    split, whole = count(view, near, BLOCKS)[0], count(view, near, 1)[0]
    assert np.allclose(split.sum(axis=1), whole[:, 0])
    published = SegmentObjective(cost.views, "published")
    change = published.hard(near) - published.hard(T[None])
    assert np.allclose(published.shares(near, T).sum(axis=1), change, atol=0.05 * abs(change).max())


def test_leaving_the_view_is_no_way_out(scene):
    pair, cost = scene
    aside = se3.exp([0, 0, 0, 0, 1.0, 0]) @ pair.T_camera_lidar
    assert cost.hard(aside[None])[0] == np.inf


def test_halves_share_no_points_and_are_all(scene):
    _, cost = scene
    parts = [cost.half(odd).views[0].points for odd in (0, 1)]
    assert sum(map(len, parts)) == len(cost.views[0].points)
    assert not {p.tobytes() for p in parts[0]} & {p.tobytes() for p in parts[1]}
    two = SegmentObjective(cost.views * 2)
    assert len(two.half(0).views) == len(two.half(1).views) == 1


def test_the_prior_is_a_parabola_about_the_guess(scene):
    pair, cost = scene
    T = pair.T_camera_lidar
    prior = Prior(T, np.repeat([0.2, np.deg2rad(4)], 3))
    twist = np.array([0.05, -0.02, 0.1, 0.01, 0.02, -0.01])
    moved = se3.exp(twist) @ T
    twist[:3] = (moved - T)[:3, 3]
    assert prior(T[None])[0] == 0
    assert np.isclose(prior(moved[None])[0], 0.5 * twist @ prior.curvature @ twist, rtol=1e-3)
    bounded = SegmentObjective(cost.views, "explained", prior)
    assert np.isclose((bounded.hard(moved[None]) - cost.hard(moved[None]))[0], prior(moved[None]))
