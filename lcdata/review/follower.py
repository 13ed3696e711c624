"""What is new in a review since it was last sent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lcdata.review import names
from lcdata.review.blueprint import Axes
from lcdata.review.content import Content, Overlay, in_order, read_content
from lcdata.review.errors import axis_tops, send_curves, send_outcomes, send_references
from lcdata.review.pairs import PairSender, Row
from lcdata.review.save import (
    BLOCK,
    frustum_depth,
    send_layout,
    send_summary,
    send_texts,
    time_columns,
)
from lcdata.review.shown import Shown
from lcdata.review.thinning import Thinning

if TYPE_CHECKING:
    import rerun as rr

    from lcdata.dataset.schema import PairRecord

GROWN = 1.5
"""A layout is sent again when an axis is so much too short: it undoes what a reader has moved."""


class Follower:
    """Sends what is new since it was last asked.

    Args:
        recording: Where all pairs have been sent.
        shown: What they were sent with.
        thinning: What is kept of each pair.
    """

    def __init__(self, recording: rr.RecordingStream, shown: Shown, thinning: Thinning) -> None:
        self.recording = recording
        self.shown = shown
        self.thinning = thinning
        self._sender = PairSender(recording, shown, frustum_m=frustum_depth(shown.dataset))
        self._tops = axis_tops(shown.trials, [r.pair_id for r in shown.dataset.pairs])

    def update(self, later: Shown) -> int:
        """Send the trials of `later` that are new or other than those sent; how many pairs."""
        before, records = self.shown, later.dataset.pairs
        new = [s for s in later.sources if s not in before.sources]
        changed = [
            number
            for number, record in enumerate(records)
            if _signature(before, record) != _signature(later, record)
        ]
        self.shown = self._sender.shown = later
        if not changed:
            return 0
        if new:  # an overlay lasts until the next: none where there is no trial
            rows = [Row(n, record, _empty(record, later)) for n, record in enumerate(records)]
            for source in new:
                self._sender.send_overlay(source, rows)
            self._sender.send_results(rows)
        self._send_pairs(changed)
        self._send_series(changed, bool(new))
        send_texts(self.recording, later, changed)
        send_summary(self.recording, later, self.thinning.note)
        return len(changed)

    def _send_pairs(self, numbers: Sequence[int]) -> None:
        later, records = self.shown, self.shown.dataset.pairs

        def read(number: int) -> Content:
            record = records[number]
            extrinsics = later.extrinsics(record)
            return read_content(
                later.dataset, record, extrinsics, names.GROUND_TRUTH, self.thinning
            )

        block: list[Row] = []
        for number, content in zip(numbers, in_order(read, numbers), strict=True):
            block.append(Row(number, records[number], content))
            if len(block) == BLOCK or number == numbers[-1]:
                for source in later.sources:
                    if source != names.GROUND_TRUTH:
                        self._sender.send_overlay(source, block)
                self._sender.send_results(block)
                block = []

    def _send_series(self, numbers: Sequence[int], new_methods: bool) -> None:
        later, records = self.shown, self.shown.dataset.pairs
        pair_ids = [record.pair_id for record in records]

        def at(rows: Sequence[int]) -> list[Any]:
            return time_columns(records, rows)

        send_curves(self.recording, later.trials, later.colours, pair_ids, numbers, at)
        only = None if new_methods else numbers
        send_outcomes(self.recording, later.trials, records, at, only)
        tops = axis_tops(later.trials, pair_ids)
        added = tops.keys() - self._tops.keys()
        poses = [later.dataset.pose(record.pose_id) for record in records]
        send_references(self.recording, added, poses, at)
        short = any(tops[name] > GROWN * self._tops[name] for name in tops if name not in added)
        if new_methods or added or short:
            self._tops = tops
            send_layout(self.recording, later, Axes(tops))


def _signature(shown: Shown, record: PairRecord) -> dict[str, tuple[bytes, str]]:
    """What tells whether a pair's trials are still those that were sent."""
    found = {}
    for method, trial in shown.trials.of_pair(record.pair_id).items():
        T = trial.T_camera_lidar_estimated
        flags = f"{trial.converged} {trial.degenerate} {trial.message}"
        found[method] = b"" if T is None else np.asarray(T).tobytes(), flags
    return found


def _empty(record: PairRecord, shown: Shown) -> Content:
    """A pair with nothing over its image."""
    nothing = Overlay(np.zeros((0, 2), np.float32), np.zeros(0, np.uint32))
    overlays = dict.fromkeys(shown.sources, nothing)
    points = np.zeros((0, 3), np.float32)
    return Content(record.pair_id, b"", "", points, np.zeros(0, np.uint32), overlays)
