"""How much a search may do before it gives up, aloud."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from pcm_gym.mechanism.validation import positive_number

# In tests, some tenths of a microsecond each: about a minute.
DEFAULT_SEARCH_BUDGET = 2e8

_most = ContextVar("search_budget", default=DEFAULT_SEARCH_BUDGET)


class SearchBudgetError(RuntimeError):
    """A search was given up because it had spent its budget: what it had found until then may not be all there is."""


@contextmanager
def search_budget(tests: float) -> Iterator[None]:
    """Return a context in which every search for all equilibria of a problem may make so many tests.

    That is each `solve_forward` and `solve_inverse` for itself, those inside of other functions included. Outside of
    all contexts it is 2e8 tests, about a minute; ordinary problems take a hundredth of that, or less. A search that
    meets its budget raises `SearchBudgetError`. What it takes does not depend on the computer.

    Parameters
    ----------
    tests : float
        Of a combination of rods each, some tenths of a microsecond; inf for no end.

    Raises
    ------
    TypeError, ValueError
        If it is no number greater than 0.
    """
    given: object = tests
    is_endless = isinstance(given, float) and given == math.inf
    token = _most.set(math.inf if is_endless else positive_number("tests", tests))
    try:
        yield
    finally:
        _most.reset(token)


class Spending:
    """What one search has spent of its budget.

    Parameters
    ----------
    what : str
        What is searched for, in words that go on "the search for".
    """

    def __init__(self, what: str) -> None:
        self._what, self._most, self._spent = what, _most.get(), 0

    def spend(self, tests: int) -> None:
        """Count some tests more.

        Raises
        ------
        SearchBudgetError
            If they are too many.
        """
        self._spent += tests
        if self._spent > self._most:
            raise SearchBudgetError(
                f"the search for {self._what} was given up after {self._spent:.3g} tests, its budget is "
                f"{self._most:.3g}: ask for a smaller rho_max, or allow more in `with pcm_gym.search_budget(tests):`"
            )
