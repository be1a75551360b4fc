"""The rows of all files of an import while they become values in SI units: what cannot be used is refused, or counted.

SourceRows(files, conventions, wanted, needed)          .numbers, .in_unit, .texts, .times, .places
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from wsnsim.base.arrays import Bools, Floats, since
from wsnsim.base.errors import RunError, UsageError, counted, did_you_mean
from wsnsim.interop.conventions import (
    Conventions,
    column_roles,
    converted,
    local_metres,
    origin_note,
    plain,
    seconds,
    unit_in,
)  # fmt: skip
from wsnsim.interop.tables import RawTable, listed, numeric, read_table
from wsnsim.models.csvfile import IDENTIFIER, LONGEST_NAME, number_in
from wsnsim.models.row_checks import more_like_it
from wsnsim.models.unit_checks import degrees_said, other_units, remedy, too_close

NO_VALUE: Final = ("", "nan", "na", "n/a", "null", "none", "-", "--", "<na>", "nat")
"""Cells that hold nothing, without case."""
LATEST: Final = 1e11
"""s: a greater number of seconds since 1970 is beyond the year 5000, and means milliseconds."""
NAMED_BY: Final = {"readings": "node", "nodes": "id", "track": "id"}
"""Our name of the column of names, of each kind."""
DAY: Final = 86400.0
"""s: after a step back by more than half of it, a clock without a date has passed midnight."""
Layout = Callable[[RawTable, dict[str, str], Conventions], pd.DataFrame]
"""The wanted columns of a table, by our names. What it takes from other columns is in `attrs["used"]`."""


def columns_of(raw: RawTable, roles: dict[str, str], how: Conventions) -> pd.DataFrame:
    """The columns of a table by our names."""
    return raw.frame[list(roles.values())].set_axis(list(roles), axis=1)


def without(path: str, frame: pd.DataFrame, ours: str) -> UsageError:
    """The error of a table that lacks a column."""
    has = listed(list(frame.columns))
    return UsageError(f"{path}: no column is called {ours} or alike, it has {has}: say which: --column {ours}=NAME")


class SourceRows:
    """The n rows of all files.

    Attributes:
        frame: The columns that were found, by our names, and number of the file and line (or row) of each.
        kept: (n,) which rows are not left out.
        notes: What was left out and why, and what was assumed.
        kind: The kind of import, for messages.
        unused: Of each file, the columns that are not used and look like names.
    """

    def __init__(
        self, files: Sequence[str], how: Conventions, kind: str, wanted: Sequence[str], layout: Layout = columns_of
    ) -> None:
        """Read the files; raises UsageError or RunError as `read_table` and `column_roles`."""
        self.files, self.how, self.kind, self.notes = files, how, kind, list[str]()
        self.unused, self._marks = list[pd.DataFrame](), set[str]()
        self._tables, self._headers, parts = list[RawTable](), dict[str, str](), list[pd.DataFrame]()
        for number, path in enumerate(files):
            raw = read_table(path, how.columns, how.is_text, how.table)
            raw = raw._replace(frame=self._chosen(path, _with_dates(raw.frame)))
            names = list(raw.frame.columns)
            roles = column_roles(path, names, wanted, how.names)
            if how.rate and "time" in roles:
                raise UsageError(f"{path}: --rate is for files without times, '{roles['time']}' has them; "
                                 "--column time= does without")  # fmt: skip
            if how.rate:
                raw.frame["time"], roles["time"] = np.arange(len(raw.frame)) / how.rate, "time"
            part = layout(raw, roles, how)
            unused = [name for name in names if name not in {*roles.values(), *part.attrs.get("used", ())}]
            named = [name for name in unused if name not in how.where and names_something(name, raw.frame[name])]
            self.notes += [f"{path}: columns not used: {listed(unused)}"] * bool(unused)
            if (ours := NAMED_BY.get(kind)) and (like := [name for name in named if IDENTIFIER.search(plain(name))]):
                self.notes.append(f"{listed(like)} may name the {ours}: --column '{ours}={like[0]}' uses it")
            self.unused.append(raw.frame[named])
            self._demand_same_units(path, roles)
            self.notes += [f"{path}: {part.attrs['note']}"] if "note" in part.attrs else []
            self._headers |= roles
            self._tables.append(raw)
            parts.append(part.assign(file=number, line=part.index))
        self.frame = pd.concat(parts, ignore_index=True)
        self.kept: Bools = np.ones(len(self.frame), dtype=np.bool_)

    def _chosen(self, path: str, frame: pd.DataFrame) -> pd.DataFrame:
        """The rows that are asked for. Raises UsageError if there is none."""
        for column, cell in self.how.where.items():
            if column not in frame:
                raise UsageError(f"{path}: no column '{column}' ({did_you_mean(column, frame.columns)})")
            texts = frame[column].astype(str).str.strip()
            used = texts == cell
            if not used.any():
                raise UsageError(f"{path}: no row has the {column} '{cell}' ({did_you_mean(cell, texts.unique())})")
            self.notes += [f"{path}: with another {column}: {counted(int((~used).sum()), 'row')}"] * (not used.all())
            frame = frame[used]
        return frame.copy()

    def _demand_same_units(self, path: str, roles: Mapping[str, str]) -> None:
        """Raise UsageError if the header of a file states another unit than that of an earlier one."""
        for ours, theirs in roles.items():
            if unit_in(known := self._headers.get(ours, theirs)) != unit_in(theirs):
                raise UsageError(f"{path}: '{theirs}' is '{known}' in another file: import files of one unit together")

    def place(self, i: int) -> str:
        """Where a row stands: file and line."""
        path, _, by_line, _ = self._tables[self.frame.file[i]]
        return f"{path}:{self.frame.line[i]}" if by_line else f"{path}: row {self.frame.line[i]}"

    def named(self, ours: str) -> str:
        """The file's name of a column."""
        return self._headers.get(ours, ours)

    def demand(self, ours: str) -> pd.Series:
        """A column. Raises UsageError if a file lacks it."""
        if ours not in self.frame:
            rate = "; without times: --rate HZ" if ours == "time" and self.kind in ("readings", "track") else ""
            raise UsageError(f"{without(self.files[0], self._tables[0].frame, ours)}{rate}")
        return self.frame[ours]

    def stems(self) -> Any:
        """(n,) the name of each row's file, without endings."""
        return np.array([Path(path).name.split(".")[0] for path in self.files])[self.frame.file]

    def leave_out(self, where: Bools, why: str) -> None:
        """Leave out the rows `where` (n,), and say so."""
        if (found := np.flatnonzero(where & self.kept)).size:
            self.kept &= ~where
            first = f"{'the first: ' * (found.size > 1)}{self.place(found[0])}"
            self.notes.append(f"left out: {counted(found.size, 'row')} {why} ({first})")

    def refuse(self, where: Bools, reason: Callable[[int], str]) -> None:
        """Refuse the rows `where` (n,) with one sentence for all, or leave them out if that is asked for."""
        if not (found := np.flatnonzero(where & self.kept)).size:
            return None
        said = reason(int(found[0]))
        if self.how.skip_bad_rows:
            return self.leave_out(where, f"that cannot be used: {said}")
        more = more_like_it(found.size - 1, "--skip-bad-rows leaves them out")
        raise RunError(f"{self.place(int(found[0]))}: {said}{more}")

    def once(self, table: pd.DataFrame, keys: list[str], reason: Callable[[int], str]) -> pd.DataFrame:
        """The kept rows of a table (n,) in the order of the keys: copies are left out, contradictions refused."""
        used = table[self.kept]
        again, copies = (pd.Series(found, used.index).reindex(table.index, fill_value=False).to_numpy()
                         for found in (used.duplicated(keys), used.duplicated()))  # fmt: skip
        self.leave_out(copies, "equal to another one")
        self.refuse(again & ~copies, reason)
        return table[self.kept & ~again].sort_values(keys, kind="stable", ignore_index=True)

    def numbers(self, ours: str, optional: bool = False) -> Floats:
        """(n,) a column of numbers; rows without one are left out, or NaN if it is optional; others are refused."""
        column, marks = self.demand(ours), [text.strip().casefold() for text in self.how.missing]
        lacking = column.isna().to_numpy()
        if pd.api.types.is_numeric_dtype(column):
            values = column.to_numpy(dtype=np.float64, na_value=np.nan)
        else:
            texts = column.astype(str).str.strip()
            values = numeric(texts).to_numpy()
            cells = texts.str.casefold()
            self._marks |= {*marks} & {*cells}
            lacking = lacking | cells.isin([*NO_VALUE, *marks]).to_numpy()
        marked = {mark: values == number_in(mark) for mark in marks}
        self._marks |= {mark for mark, where in marked.items() if where.any() or (mark in NO_VALUE and lacking.any())}
        lacking = np.any([lacking, *marked.values()], axis=0)
        if not optional:
            self.leave_out(lacking, f"without {ours}")
        name = self.named(ours)
        self.refuse(~lacking & ~np.isfinite(values), lambda i: f"{name} must be a finite number, is "
                    f"{_cell(column[i])}{_of_marks(str(column[i]))}")  # fmt: skip
        return np.where(lacking, np.nan, values)

    @property
    def unseen(self) -> list[str]:
        """A sentence for each value that stands for no reading, and that no row has."""
        missing = [text for text in self.how.missing if text.strip().casefold() not in self._marks]
        return [f"--missing {text}: no row has it" for text in missing]

    def in_unit(self, ours: str, bases: Sequence[str], optional: bool = False) -> tuple[Floats, str]:
        """(n,) a column of numbers in SI units or dBm, and its unit; what the header states in brackets counts.

        Raises:
            UsageError: Header and `--unit` contradict each other, or the unit has another dimension than the bases.
        """
        stated, name = unit_in(self.named(ours)), self.named(ours)
        if stated and self.how.unit and stated != self.how.unit:
            raise UsageError(f"{self.files[0]}: '{name}' states {stated}, --unit {self.how.unit}: leave --unit out, "
                             "or rename the column")  # fmt: skip
        numbers = self.numbers(ours, optional)
        values, unit = converted(numbers, self.how.unit or stated, bases)
        self.refuse(
            np.isfinite(numbers) & ~np.isfinite(values),
            lambda i: f"{name} must be a positive power, to have a level in dBm",
        )
        return values, unit

    def texts(self, ours: str) -> Any:
        """(n,) a column of names; rows without one are refused."""
        column, name = self.demand(ours), self.named(ours)
        if pd.api.types.is_float_dtype(column) and (column.dropna() % 1 == 0).all():
            column = column.astype("Int64")  # 3.0 of a spreadsheet is the node 3
        texts = column.astype(str).str.strip()
        self.refuse((column.isna() | (texts == "")).to_numpy(), lambda i: f"{name} must not be empty")
        long = (texts.str.len() > LONGEST_NAME).to_numpy()
        self.refuse(long, lambda i: f"{name} must have at most {LONGEST_NAME} characters")
        return texts.to_numpy(dtype=object)

    def times(self) -> Floats:
        """(n,) times in s, after the time origin. Raises UsageError if the origin is no time."""
        column, origin, name = self.demand("time"), self.how.time_origin, self.named("time")
        form = self.how.time_format or unit_in(name)
        times, dated = seconds(column, form)
        allowed = ("a time of the format that is given" if form else "a number of seconds or an ISO 8601 date (others: "
                   "--time-format, such as '%m/%d/%Y %I:%M:%S %p')")  # fmt: skip
        self.refuse(~np.isfinite(times), lambda i: f"{name} must be {allowed}, is {_cell(column[i])}")
        if not (dated or form) and ":" in str(column.iloc[0]):
            back = pd.Series(times).groupby(self.frame.file).diff() < -DAY / 2.0
            times = times + DAY * back.groupby(self.frame.file).cumsum().to_numpy()
            self.notes += [f"{back.sum():,} times the clock passes midnight: a day is added there"] * bool(back.any())
        late = np.abs(times) > LATEST
        self.refuse(late, lambda i: f"{times[i]:.15g} s is beyond the year 5000, another unit? Write: "
                    f"{self.remedy(f'--time-format {_shorter(column[i])}')}")  # fmt: skip
        if not origin:
            self.notes += ["times are s since 1970-01-01 UTC; --time-origin DATE makes one of them 0"] * dated
            return times
        after: Floats = since(times, self.moment("--time-origin", origin))
        if self.kept.any() and (far := np.abs(after[self.kept]).min()) > max(DAY, np.ptp(after[self.kept])):
            self.notes.append(f"all times are {far / DAY:,.1f} days or more from --time-origin {origin}: another date? "
                              f"The first row has {_cell(column.iloc[0])}")  # fmt: skip
        return after

    def moment(self, option: str, text: str, missing: float = 0.0) -> float:
        """The time (s) that an option gives, written as the file writes times; `missing` without it."""
        if not text:
            return missing
        form, such = self.how.time_format or unit_in(self.named("time")), self.frame.time[:1]
        (time,), dated = seconds(pd.Series([text]), form)
        is_clock, of_clock = (":" in str(each[0]) and not seconds(each, form)[1] for each in (pd.Series([text]), such))
        if not np.isfinite(time) or ((dated or is_clock) and is_clock != of_clock):
            raise UsageError(f"{option} {text}: must be a time as the file writes them, such as {such[0]}")
        return float(time)

    def span(self) -> list[float]:
        """First and last time (s) that are asked for, after the time origin; infinite where none is."""
        ends = zip(("--from", "--until"), self.how.span, (-np.inf, np.inf), strict=True)
        return [since(self.moment(*each), self.moment("--time-origin", self.how.time_origin)) for each in ends]

    def places(self) -> tuple[dict[str, Floats], tuple[float, ...]]:
        """{axis: (n,) m}, and the origin in degrees if places were projected."""
        geographic = {"lon", "lat"} <= set(self.frame)
        if not (geographic or self.how.crs):
            axes = [axis for axis in "xyz" if axis in ("x", "y", *self.frame)]
            self._demand_one_unit(axes)
            flat = {axis: self.in_unit(axis, ("m",), optional=axis == "z")[0] for axis in axes}
            if said := too_close(np.column_stack([flat["x"], flat["y"]])[self.kept]):
                self.notes.append(f"{said}; {other_units(self.files[0], self.kind)}")
            return self._with_heights(flat), ()
        if geographic and not self.how.crs and not self._tables[0].degrees:
            raise UsageError(degrees_said(self.files[0], self.kind, self.named("lon"), self.named("lat")))
        lon, lat = (self.numbers(axis) for axis in (("lon", "lat") if geographic else "xy"))
        outside = (np.abs(lon) > 180.0) | (np.abs(lat) > 90.0)
        self.refuse(outside, lambda i: f"a longitude and a latitude are expected, found {lon[i]:g} and {lat[i]:g}")
        x, y, origin = local_metres(lon, lat, self.kept, self.how.origin)
        self.notes.append(origin_note(origin))
        heights = {"z": self.numbers("z", optional=True) - (*origin, 0.0)[2]} if "z" in self.frame else {}
        return self._with_heights({"x": x, "y": y, **heights}), origin

    def _demand_one_unit(self, axes: Sequence[str]) -> None:
        """Raise UsageError if the headers of some axes alone state a unit."""
        units = {self.named(axis): unit_in(self.named(axis)) for axis in axes if axis in self.frame}
        known = [unit for unit in units.values() if unit not in ("", "m")]
        if known and "" in units.values():
            bare = listed([name for name, unit in units.items() if not unit])
            raise UsageError(f"{self.files[0]}: {bare} without a unit, others in {known[0]}: name it in the header too")

    def _with_heights(self, places: dict[str, Floats]) -> dict[str, Floats]:
        """The places (n,), without heights, and a note, where one of them is not known."""
        lacking = ~np.isfinite(places.get("z", np.zeros(1)))
        if lacking.size > 1 and (lacking := lacking & self.kept).any():
            self.notes.append(f"z is left out of all: {counted(int(lacking.sum()), 'row')} without it")
        return {axis: values for axis, values in places.items() if axis != "z" or not lacking.any()}

    def remedy(self, option: str) -> str:
        """The command line that reads the first file with another option."""
        return remedy(self.files[0], self.kind, option)


def names_something(name: str, cells: pd.Series) -> bool:
    """Whether a column looks like names: by its own name if it has whole numbers, and always if it has words."""
    if pd.api.types.is_bool_dtype(cells) or pd.api.types.is_datetime64_any_dtype(cells):
        return False
    if pd.api.types.is_numeric_dtype(cells):
        return bool(IDENTIFIER.search(plain(name))) and bool((cells.dropna() % 1 == 0).all())
    return bool(IDENTIFIER.search(plain(name))) or bool(numeric(cells).isna().all())


def _of_marks(cell: str) -> str:
    """What is said of a number with a comma that is not the file's decimal mark."""
    digits = cell.strip(" +-").replace(",", "").replace(".", "")
    return "; a file has one decimal mark, and thousands have none" * ("," in cell and digits.isdigit())


def _shorter(time: Any) -> str:
    """The unit in which a number since 1970 is a time before the year 5000."""
    return next((unit for unit, size in (("ms", 1e3), ("us", 1e6)) if abs(float(time)) <= LATEST * size), "ns")


def _cell(value: Any) -> str:
    return repr(str(value)[:60])


def _with_dates(frame: pd.DataFrame) -> pd.DataFrame:
    """The columns, `date` and `time` joined where both are there."""
    named = {plain(name): name for name in frame.columns}
    if not {"date", "time"} <= set(named):
        return frame
    date, time = named["date"], named["time"]
    joined: Mapping[str, Any] = {time: frame[date].astype(str) + " " + frame[time].astype(str)}
    return frame.assign(**joined).drop(columns=date)
