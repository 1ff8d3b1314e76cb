"""Several records of one kind, found by name or number."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import overload

from lumbar.base.errors import InputError
from lumbar.records.record import Record


class RecordSet(Sequence[Record]):
    """Records that were made alike, one per excitation.

    Parameters
    ----------
    records : iterable of Record
        With names of their own.

    Raises
    ------
    InputError
        If two records share a name.
    """

    def __init__(self, records: Iterable[Record]):
        self._records = list(records)
        names = self.names
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(
                f"records share the name {', '.join(map(repr, twice))}: each needs one of its own"
            )

    @property
    def names(self) -> list[str]:
        """Names of the records, in their order."""
        return [record.name for record in self._records]

    def __len__(self) -> int:
        return len(self._records)

    @overload
    def __getitem__(self, which: int | str) -> Record: ...
    @overload
    def __getitem__(self, which: slice) -> RecordSet: ...
    def __getitem__(self, which):
        if isinstance(which, slice):
            return RecordSet(self._records[which])
        if isinstance(which, str):
            self._check_names([which])
            return self._records[self.names.index(which)]
        return self._records[which]

    def with_periods(self, periods: Mapping[str, float]) -> RecordSet:
        """Return the records with the periods of their excitations in seconds, by the record's name."""
        self._check_names(periods)
        return RecordSet(
            replace(record, period=periods.get(record.name, record.period)) for record in self._records
        )

    def _check_names(self, names: Iterable[str]) -> None:
        for name in names:
            if name not in self.names:
                raise InputError(f"no record {name!r}; there are {', '.join(self.names)}")

    def rows(self) -> list[dict]:
        """What every record is: one dict per record, for tables."""
        return [
            {
                "record": record.name,
                "samples": len(record),
                "rate (Hz)": round(1 / record.sampling_time, 4),
                "duration (s)": round(record.duration, 4),
                "channels": ", ".join(f"{item.quantity} ({item.unit})" for item in record.channels.values()),
            }
            for record in self._records
        ]

    def __repr__(self) -> str:
        lines = [
            f"  {row['record']}: {row['samples']} samples at {row['rate (Hz)']:g} Hz, {row['duration (s)']:g} s; "
            f"{row['channels']}"
            for row in self.rows()
        ]
        return "\n".join([f"{len(self)} record{'s' * (len(self) != 1)}", *lines])

    def _repr_html_(self) -> str:
        import pandas as pd

        return pd.DataFrame(self.rows()).to_html(index=False)
