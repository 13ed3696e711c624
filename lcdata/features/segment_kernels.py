"""The consistency of LiDAR points within image masks, at many poses, compiled.

One pass over the points of a pose: transform, project by any camera model, look up the masks of
the pixel, count; then one over the masks. numba kernels: import this module only where it is used.
"""

# ruff: noqa: PLR0912, PLR0915 - a compiled loop is written out, on plain arrays

from __future__ import annotations

import numpy as np
from numba import njit

from lcdata.geometry.camera_kernels import project_point

FAST = {"contract", "arcp", "reassoc", "nsz"}

CLASSES = 64
"""Classes that are counted; a point of class `CLASSES` belongs to none."""


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def consistency(  # type: ignore[no-untyped-def]
    model,
    parameters,
    poses,
    points,
    light,
    directions,
    classes,
    labels,
    fewest,
    groups,
    gram,
    sums,
    pooled,
    inside,
):
    """Consistency of the attributes within the masks: sums over masks and their weights.

    For a mask with n points: the mean |n_i . n_j| over all pairs of normals, 1 - the standard
    deviation of the intensities, and sum_k 2^-k p_k with the shares p_0 >= p_1 >= .. of the
    classes. Masks with fewer points than they should have do not count.

    Args:
        model: Number of the camera model.
        parameters: Its parameters, for the labels' size.
        poses: (P, 12) R row by row, then t, of `T_camera_lidar`.
        points: (N, 3) float32 in the LiDAR frame, metres.
        light: (N,) float32 intensities, 0 .. 1.
        directions: (N,) uint8 direction of the normal, a row of `gram`.
        classes: (N,) uint8, at most `CLASSES`.
        labels: (h, w, K) uint16 masks of each pixel; 0 for none, masks from 1 on.
        fewest: (M + 1,) least points of each mask.
        groups: (M + 1,) int32 group of each mask, below G.
        gram: (D, D) |cosine| between directions.
        sums: (P, G, 6) for each group of masks: sum of weighted normal, intensity and class
            consistency, then the weights: points with a normal, an intensity, a class. Set.
        pooled: (P, 3) the same three consistencies of all counted points as one mask. Set.
        inside: (P,) points in the image. Set.
    """
    height, width, layers = labels.shape
    right, bottom = width - 0.5, height - 0.5
    masks = fewest.shape[0]
    bins = gram.shape[0]
    number = np.zeros(masks, np.int32)
    first = np.zeros(masks, np.float64)
    second = np.zeros(masks, np.float64)
    by_direction = np.zeros((masks, bins), np.int32)
    by_class = np.zeros((masks, CLASSES + 1), np.int32)
    filled = np.zeros(bins, np.int32)
    shares = np.zeros(CLASSES, np.int32)
    all_directions = np.zeros(bins, np.float64)
    all_classes = np.zeros(CLASSES + 1, np.float64)
    sums[:] = 0.0
    pooled[:] = 0.0
    for k in range(poses.shape[0]):
        r00, r01, r02, r10, r11, r12, r20, r21, r22, tx, ty, tz = poses[k]
        number[:] = 0
        first[:] = 0.0
        second[:] = 0.0
        by_direction[:] = 0
        by_class[:] = 0
        seen = 0
        for i in range(points.shape[0]):
            x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
            u, v, ok = project_point(
                model,
                parameters,
                r00 * x + r01 * y + r02 * z + tx,
                r10 * x + r11 * y + r12 * z + ty,
                r20 * x + r21 * y + r22 * z + tz,
            )
            if not (ok and u >= -0.5 and v >= -0.5 and u < right and v < bottom):
                continue
            seen += 1
            row, column = np.int32(v + 0.5), np.int32(u + 0.5)
            for layer in range(layers):
                own = np.int64(labels[row, column, layer])
                if own == 0:
                    continue
                number[own] += 1
                first[own] += light[i]
                second[own] += light[i] * light[i]
                by_direction[own, directions[i]] += 1
                by_class[own, classes[i]] += 1
        inside[k] = seen
        all_directions[:] = 0.0
        all_classes[:] = 0.0
        points_all = 0.0
        first_all = 0.0
        second_all = 0.0
        for m in range(1, masks):
            n = float(number[m])
            if n < 1 or n < fewest[m]:
                continue
            group = groups[m]
            points_all += n
            first_all += first[m]
            second_all += second[m]
            count = 0
            for a in range(bins):
                if by_direction[m, a] > 0:
                    filled[count] = a
                    count += 1
                    all_directions[a] += by_direction[m, a]
            total = 0.0
            for p in range(count):
                a = filled[p]
                part = 0.5 * gram[a, a] * by_direction[m, a]
                for q in range(p):
                    part += gram[a, filled[q]] * by_direction[m, filled[q]]
                total += 2.0 * part * by_direction[m, a]
            sums[k, group, 0] += total / n
            sums[k, group, 3] += n
            mean = first[m] / n
            sums[k, group, 1] += n * (1.0 - np.sqrt(max(second[m] / n - mean * mean, 0.0)))
            sums[k, group, 4] += n
            kinds = 0
            for a in range(CLASSES):
                c = by_class[m, a]
                if c > 0:
                    place = kinds
                    while place > 0 and shares[place - 1] < c:
                        shares[place] = shares[place - 1]
                        place -= 1
                    shares[place] = c
                    kinds += 1
                    sums[k, group, 5] += c
                    all_classes[a] += c
            factor = 1.0
            for p in range(kinds):
                sums[k, group, 2] += factor * shares[p]
                factor *= 0.5
        if points_all == 0.0:
            continue
        total = 0.0
        for a in range(bins):
            for b in range(bins):
                total += all_directions[a] * gram[a, b] * all_directions[b]
        pooled[k, 0] = total / (points_all * points_all)
        mean = first_all / points_all
        pooled[k, 1] = 1.0 - np.sqrt(max(second_all / points_all - mean * mean, 0.0))
        ordered = np.sort(all_classes)
        factor, total, count_all = 1.0, 0.0, 0.0
        for a in range(CLASSES, 0, -1):
            total += factor * ordered[a]
            count_all += ordered[a]
            factor *= 0.5
        pooled[k, 2] = total / max(count_all, 1.0)
