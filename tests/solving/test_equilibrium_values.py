"""An equilibrium is a value: equal parts make equal equilibria, and parts that cannot be right are refused."""

import math
import pickle
from typing import Any

import numpy as np
import pytest

import pcm_gym
from pcm_gym import Equilibrium

MECHANISM = pcm_gym.get_mechanism("2RFR-paper")
PARTS: dict[str, Any] = {
    "mechanism": MECHANISM,
    "state": np.array([5.0, 0.0, 5.0, -1.0, 0.0, 0.8]),
    "inputs": np.array([1.2, 1.9]),
    "load": np.array([0.0, 8.0]),
}


def made(**changed: Any) -> Equilibrium:
    return Equilibrium(**{**PARTS, **changed})


def test_equal_parts_make_equal_equilibria_that_hash_alike() -> None:
    first, second = made(), made(state=PARTS["state"].tolist(), inputs=tuple(PARTS["inputs"]))
    assert first is not second
    assert first == second
    assert hash(first) == hash(second)
    assert {first: "known"}[second] == "known"


@pytest.mark.parametrize(
    "changed",
    [
        {"mechanism": pcm_gym.get_mechanism("2PFR-paper")},
        {"state": np.nextafter(PARTS["state"], 9.0)},
        {"inputs": np.nextafter(PARTS["inputs"], 9.0)},
        {"load": np.nextafter(PARTS["load"], 9.0)},
    ],
    ids=lambda changed: str(*changed),
)
def test_one_part_that_differs_in_its_last_bit_makes_another_equilibrium(changed: dict[str, Any]) -> None:
    assert made(**changed) != made()
    assert len({made(**changed), made()}) == 2


def test_both_zeros_are_one() -> None:
    negative = made(state=np.array([5.0, -0.0, 5.0, -1.0, -0.0, 0.8]), load=np.array([-0.0, 8.0]))
    assert negative == made()
    assert hash(negative) == hash(made())


def test_equilibrium_equals_nothing_else() -> None:
    assert made() != "an equilibrium"
    assert made() != tuple(PARTS.values())


def test_solvers_make_the_same_values_as_hands_do() -> None:
    home = pcm_gym.home_equilibrium(MECHANISM)
    by_hand = Equilibrium(MECHANISM, home.state, home.inputs, home.load)
    assert (by_hand, hash(by_hand)) == (home, hash(home))
    assert pickle.loads(pickle.dumps(home)) == home
    tracked = [pcm_gym.BranchTracker(MECHANISM, home).step(home.inputs + 0.1).equilibrium for _ in range(2)]
    assert tracked[0] == tracked[1] != home


@pytest.mark.parametrize("copy", [lambda found: found, lambda found: pickle.loads(pickle.dumps(found))])
def test_arrays_are_copies_that_cannot_be_written_to(copy: Any) -> None:
    state = PARTS["state"].copy()
    found = copy(made(state=state))
    state[0] = 9.0
    assert found == made()
    for array in (found.state, found.inputs, found.load):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize(
    ("part", "value", "error", "allowed", "shown"),
    [
        ("mechanism", "2RFR", TypeError, "a Mechanism", "'2RFR'"),
        ("mechanism", None, TypeError, "a Mechanism", "None"),
        ("state", np.zeros(5), ValueError, "shape (6,)", "(5,)"),
        ("state", np.zeros((1, 6)), ValueError, "shape (6,)", "(1, 6)"),
        ("state", [0.0, 0.0, 0.0, 0.0, 0.0, math.nan], ValueError, "finite", "nan"),
        ("state", "state", TypeError, "6 numbers", "'state'"),
        ("inputs", [0.0], ValueError, "shape (2,)", "(1,)"),
        ("inputs", [0.0, math.inf], ValueError, "finite", "inf"),
        ("inputs", ["0.1", "0.2"], TypeError, "2 numbers", "'0.1'"),
        ("inputs", [0.0, 1.0j], TypeError, "2 numbers", "1j"),
        ("inputs", 1.0, ValueError, "shape (2,)", "()"),
        ("load", [0.0, 0.0, 0.0], ValueError, "shape (2,)", "(3,)"),
        ("load", None, TypeError, "2 numbers", "None"),
        ("load", [[0.0], [0.0, 1.0]], TypeError, "2 numbers", "[0.0, 1.0]"),
    ],
)
def test_error_names_part_value_and_what_is_allowed(
    part: str, value: Any, error: type[Exception], allowed: str, shown: str
) -> None:
    with pytest.raises(error) as caught:
        made(**{part: value})
    for said in (part, allowed, shown):
        assert said in str(caught.value)
