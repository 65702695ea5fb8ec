"""Golden scenarios come to what they came to: events, indices and counts exactly, real numbers to 1e-9.

`python -m tests.golden make` writes what is compared with. A change of it is a change of behaviour: it has to be meant.

That another processor meets it was tried with other C and BLAS libraries, and with the sine and the cosine under every
elliptic function wrong by one unit in the last place: whatever did not hold was left to the digests.
"""

import pytest

from tests.golden.records import differences
from tests.golden.scenarios import PATH, PORTABLE, SCENARIOS, read_golden

GOLDEN = read_golden()


def test_every_scenario_is_kept_and_nothing_else() -> None:
    assert GOLDEN.keys() == set(PORTABLE)
    assert PATH.stat().st_size < 1.5e6


@pytest.mark.parametrize("name", PORTABLE)
def test_scenario_comes_to_what_it_came_to(name: str) -> None:
    assert differences(SCENARIOS[name](), GOLDEN[name]) == []
