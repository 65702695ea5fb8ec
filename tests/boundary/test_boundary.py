"""Every public callable refuses what is wrong, in words, and takes what is right in any layout without compiling anew.

The whole matrix is ``python -m tests.boundary``; here is a sample, which has a case of each argument of each door.
"""

import enum
import inspect
from typing import Any, is_typeddict

import numpy as np
import pytest

import pcm_gym
from tests.boundary.doors import doors, home
from tests.boundary.matrix import LONGEST, Judge, cases, overload_counts, sample

SAMPLED = 3500
# What is no door, and why.
EXEMPT = {
    "Equilibrium.unchecked": "its name says so: solvers make equilibria by it, of arrays that they have made",
    "Atlas.save": "it writes a file: the tests of the atlas",
    "AtlasError": "an exception",
    "DesignError": "an exception",
    "PlanningError": "an exception",
    "RodCrossing": "a named tuple, which the package hands out",
    "MechanismFileError": "an exception",
    "Policy.save": "it writes a file: the tests of policies",
    "Policy.save_onnx": "it writes a file: the tests of ONNX models",
    "PolicyError": "an exception",
    "SearchBudgetError": "an exception",
    "Task.progress_metrics": "a hook, which the package calls",
    "Task.succeeded": "a hook, which the package calls",
    "save_mechanism": "it writes a file: the tests of mechanism files",
}
# What the package hands out; made by hand, the kinds of the parts are checked.
TOLD: tuple[str, ...] = (
    "BifurcationDiagram",
    "Branch",
    "Calibration",
    "Certificate",
    "CriticalLoad",
    "Crossing",
    "DesignDerivatives",
    "Element",
    "EquilibriumSet",
    "Family",
    "NearestFold",
    "OptimisedDesign",
    "PathCertificate",
    "Preview",
    "Snap",
)
TOLD += ("SpecialPoint", "TrackedStep", "UndecidedRegion")


def public_callables() -> set[str]:
    """Names of all functions and classes, and of the methods that the package itself gives these."""
    found = set()
    for name in pcm_gym.__all__:
        own = getattr(pcm_gym, name)
        if not callable(own) or is_typeddict(own) or (isinstance(own, type) and issubclass(own, enum.Enum)):
            continue
        found.add(name)
        for key, member in vars(own).items() if isinstance(own, type) else ():
            function = member.__func__ if isinstance(member, classmethod | staticmethod) else member
            if not key.startswith("_") and inspect.isfunction(function):
                found.add(f"{name}.{key}")
    return found


def test_every_public_callable_has_a_door() -> None:
    named = {door.name for door in doors()}
    missing = public_callables() - named - EXEMPT.keys() - set(TOLD)
    assert missing == set()


def test_wrong_values_are_refused_in_words_and_right_ones_taken_in_any_layout() -> None:
    judge = Judge()
    complaints = {case.name: found for case in sample(SAMPLED) if (found := judge.complaint(case)) is not None}
    assert complaints == {}
    assert judge.outcomes.total() >= 3000
    assert min(judge.outcomes["refused"], judge.outcomes["taken"]) > 100
    assert judge.slowest[1] < LONGEST


def test_a_judge_complains() -> None:
    """Doors that take what is wrong, say nothing of what they refuse, or hand out nan, are found out."""
    case = next(case for case in cases() if case.door.name == "Rod" and case.value_name == "nan")

    def complaint(call: Any) -> str | None:
        object.__setattr__(case.door, "call", call)
        return Judge().complaint(case)

    def fails(error: type[Exception], text: str) -> Any:
        def call(length: float = 1.0, **_: Any) -> float:
            if length != length:
                raise error(text)
            return length

        return call

    assert complaint(fails(ValueError, "length must be finite, got nan")) is None
    assert "does not name" in (complaint(fails(ValueError, "no")) or "")
    assert "does not show" in (complaint(fails(ValueError, "length must be finite")) or "")
    assert "IndexError" in (complaint(fails(IndexError, "length must be finite, got nan")) or "")
    assert complaint(lambda length, **_: length) == "not a number came out"


def test_the_kernels_are_counted() -> None:
    pcm_gym.Equilibrium(home("2RFR").mechanism, home("2RFR").state, home("2RFR").inputs, np.zeros(2)).energy  # noqa: B018
    counts = overload_counts()
    assert len(counts) > 100
    assert counts["pcm_gym.kernels.statics.equilibrium._describe"] == 1


@pytest.mark.parametrize("name", TOLD)
def test_what_is_told_is_of_its_kinds(name: str) -> None:
    kind = getattr(pcm_gym, name)
    required = [own for own in inspect.signature(kind).parameters.values() if own.default is own.empty]
    with pytest.raises(TypeError, match=required[0].name):
        kind(**{own.name: 1j for own in required})
