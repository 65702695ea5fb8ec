"""The layout of a block: what is declared is where it stands, and overlays are refused that would not fit."""

from typing import Any

import numpy as np
import pytest

from pcm_gym.kernels.lockstep.layout import LANES, CommonLanes, LegLanes, _runs, make_block, record_of


@pytest.mark.parametrize("lanes", [LegLanes, CommonLanes])
def test_fields_that_lie_over_none_are_apart(lanes: type) -> None:
    record = record_of(lanes)
    owners = np.zeros(record.itemsize, dtype=int)
    fields: Any = record.fields
    for name, (kind, offset) in fields.items():
        if not vars(lanes)[name].over:
            owners[offset : offset + kind.itemsize] += 1
    assert (owners == 1).all()


def test_curvature_lies_over_what_is_used_up_when_it_is_filled_and_nothing_else() -> None:
    leg = make_block(1).legs[0]
    for name in LegLanes.__annotations__:
        leg[name] = 0.0
    leg["curvature"] = 1.0
    touched = {name for name in LegLanes.__annotations__ if np.any(leg[name])}
    assert touched == {"curvature", "force_g", "dead_load_index", "clamp", "functions"}


def test_overlay_over_fields_that_are_not_in_a_row_is_refused() -> None:
    class Torn:
        first = _runs(2)
        between = _runs()
        second = _runs(2)
        over = _runs(4, over=("first", "second"))

    with pytest.raises(AssertionError, match="second does not follow"):
        record_of(Torn)


def test_overlay_that_is_too_large_is_refused() -> None:
    class Narrow:
        first = _runs(2)
        over = _runs(3, over=("first",))

    with pytest.raises(AssertionError, match="no room"):
        record_of(Narrow)


def test_runs_are_as_long_as_a_block_has_lanes() -> None:
    assert make_block(2).legs[0]["tip_g"].shape == (4, LANES)
