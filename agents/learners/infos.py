"""The infos of a batch's step: arrays for those who read them all, dictionaries for those who ask for a row."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, overload

import numpy as np

from pcm_gym.arrays import Mask

Info = dict[str, Any]

_FINAL_KEYS = frozenset({"final_obs", "_final_obs", "final_info", "_final_info"})


class Infos(Sequence[Info]):
    """What Stable-Baselines3 takes for a list of dictionaries, one per environment, each made when it is asked for.

    A dictionary once made is kept, so that what is written into it stays. `columns` are arrays over all environments,
    which cost nothing to read; what is written into a dictionary is not in them.

    Parameters
    ----------
    columns
        Arrays of length `count`, or nested mappings of them, each with the mask ``_key`` of the environments that have
        the entry; an array without a mask holds for all.
    count
        Number of environments.
    """

    def __init__(self, columns: Mapping[str, Any], count: int) -> None:
        self.columns = columns
        self._count = count
        self._made: dict[int, Info] = {}
        self._masked = _masked(columns)

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> Info: ...
    @overload
    def __getitem__(self, index: slice) -> list[Info]: ...
    def __getitem__(self, index: int | slice) -> Info | list[Info]:
        """Return the info of one environment, or a list of some."""
        if isinstance(index, slice):
            return [self[row] for row in range(*index.indices(self._count))]
        row = range(self._count)[index]
        if row not in self._made:
            self._made[row] = _row(self._masked, row)
        return self._made[row]

    def __iter__(self) -> Iterator[Info]:
        return (self[row] for row in range(self._count))


def columns_of(infos: Any) -> Mapping[str, Any]:
    """Arrays over all environments, by name, of infos that have passed for a list."""
    if not isinstance(infos, Infos):
        raise TypeError(f"infos must be those of a native batch, got {type(infos).__name__}")
    return infos.columns


def last_infos(infos: Info, truncated: Mask, terminated: Mask) -> Infos:
    """Infos of the step just taken: where the batch has already begun a new episode, those of the finished one.

    There are ``terminal_observation`` and ``TimeLimit.truncated`` besides, where an episode has ended.

    Parameters
    ----------
    infos
        As a batch returns them that resets in the same step.
    truncated, terminated
        Arrays (n,).
    """
    ended = truncated | terminated
    columns = {key: column for key, column in infos.items() if key not in _FINAL_KEYS}
    if "final_obs" in infos:
        columns = _merged(columns, infos["final_info"], ended)
        columns |= {"terminal_observation": infos["final_obs"], "_terminal_observation": infos["_final_obs"]}
    columns |= {"TimeLimit.truncated": truncated & ~terminated, "_TimeLimit.truncated": ended}
    return Infos(columns, len(ended))


def _merged(others: Info, finals: Info, ended: Mask) -> Info:
    """Columns and masks that are the finals' where an episode has ended, and else the others'."""
    merged: Info = {}
    for key in dict.fromkeys(name for infos in (others, finals) for name in infos if not _is_mask(name, infos)):
        own, final = others.get(key), finals.get(key)
        merged[f"_{key}"] = np.where(ended, _mask(finals, key, len(ended)), _mask(others, key, len(ended)))
        if isinstance(own, dict) or isinstance(final, dict):
            merged[key] = _merged(own or {}, final or {}, ended)
        elif own is None or final is None:
            merged[key] = final if own is None else own
        else:
            merged[key] = own.copy()
            merged[key][ended] = final[ended]
    return merged


# Columns by name with their masks; the column is such a mapping itself where infos are nested.
_Masked = dict[str, tuple[Any, Mask | None]]


def _masked(columns: Mapping[str, Any]) -> _Masked:
    return {
        key: (_masked(column) if isinstance(column, dict) else column, columns.get(f"_{key}"))
        for key, column in columns.items()
        if not _is_mask(key, columns)
    }


def _row(masked: _Masked, index: int) -> Info:
    """Return the entries of one environment, its numbers as Python's."""
    row = {}
    for key, (column, mask) in masked.items():
        if mask is None or mask[index]:
            value = _row(column, index) if isinstance(column, dict) else column[index]
            row[key] = value.item() if isinstance(value, np.generic) else value
    return row


def _mask(columns: Info, key: str, count: int) -> Mask:
    """Return which environments have an entry, (n,)."""
    mask: Mask = columns[f"_{key}"] if f"_{key}" in columns else np.full(count, key in columns)
    return mask


def _is_mask(key: str, columns: Mapping[str, Any]) -> bool:
    return key.startswith("_") and key[1:] in columns
