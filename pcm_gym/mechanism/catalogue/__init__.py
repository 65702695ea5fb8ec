"""The catalogued mechanisms: one file each, one line here; mechanisms from outside the package may join them."""

from collections.abc import Callable

from pcm_gym.mechanism.catalogue import three_pfr, two_pfr, two_rfr
from pcm_gym.mechanism.mechanism import Mechanism
from pcm_gym.mechanism.validation import instance_of, one_of

_MAKERS: dict[str, Callable[[], Mechanism]] = {
    "2RFR": two_rfr.make,
    "2PFR": two_pfr.make,
    "3PFR": three_pfr.make,
    # the geometries of the paper's figures, which no rod of steel would endure everywhere
    "2RFR-paper": two_rfr.make_paper,
    "2PFR-paper": two_pfr.make_paper,
    "3PFR-paper": three_pfr.make_paper,
}


def mechanism_names() -> list[str]:
    """Return the names of all catalogued mechanisms."""
    return list(_MAKERS)


def get_mechanism(name: str) -> Mechanism:
    """Return the catalogued mechanism of that name.

    "2RFR", "2PFR" and "3PFR" could be built: no rod yields or crosses what it must not, wherever stable ways from home
    lead. Those with "-paper" have the geometries of the figures after the paper.

    Raises
    ------
    ValueError
        If the name is not in the catalogue; the message lists those that are.
    """
    return _MAKERS[one_of("name", name, mechanism_names())]()


def register_mechanism(mechanism: Mechanism) -> str:
    """Add a mechanism to the catalogue of this process; return its name, under which it is then known.

    Raises
    ------
    TypeError, ValueError
        If it is no mechanism, or if another one has its name.
    """
    name = free_name(mechanism)
    _MAKERS.setdefault(name, lambda: mechanism)
    return name


def free_name(mechanism: Mechanism) -> str:
    """Return the name of a mechanism; raise if it is no mechanism, or if another one in the catalogue has its name."""
    name = instance_of("mechanism", mechanism, Mechanism).name
    if name in _MAKERS and get_mechanism(name) != mechanism:
        raise ValueError(f"name must be a new one, got {name!r}: another mechanism has it")
    return name
