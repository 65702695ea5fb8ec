"""A complete set of equilibria, and what is known of its completeness."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

from pcm_gym.solving.certification import Certificate
from pcm_gym.solving.equilibrium import Equilibrium


@dataclass(frozen=True)
class EquilibriumSet(Sequence[Equilibrium]):
    """All solutions of one forward or inverse problem: a sequence of equilibria, by ascending energy.

    Attributes
    ----------
    equilibria : tuple of Equilibrium
    reason : str
        Why the set is empty; empty itself where there are solutions.
    certificate : Certificate or None
        What is proved of the set's completeness, in all modes; None if that was not asked for.
    """

    equilibria: tuple[Equilibrium, ...]
    reason: str = ""
    certificate: Certificate | None = None

    @property
    def stable(self) -> tuple[Equilibrium, ...]:
        """The stable ones among them."""
        return tuple(found for found in self.equilibria if found.is_stable)

    @overload
    def __getitem__(self, key: int) -> Equilibrium: ...

    @overload
    def __getitem__(self, key: slice) -> tuple[Equilibrium, ...]: ...

    def __getitem__(self, key: int | slice) -> Equilibrium | tuple[Equilibrium, ...]:
        """Return one equilibrium, or a tuple of them."""
        return self.equilibria[key]

    def __len__(self) -> int:
        """Return the number of equilibria."""
        return len(self.equilibria)

    def __iter__(self) -> Iterator[Equilibrium]:
        """Return an iterator over the equilibria."""
        return iter(self.equilibria)

    def __repr__(self) -> str:
        """Return a line per equilibrium, or the reason why there is none."""
        if not self.equilibria:
            return f"EquilibriumSet of none: {self.reason}"
        return "\n".join([f"EquilibriumSet of {len(self)}:", *(f"  {found!r}" for found in self.equilibria)])
