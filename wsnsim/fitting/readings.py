"""A law is fitted to files of readings and judged on others: what is judged must not be in what was fitted.

fit_readings(files, nodes, form, test, reading, options) -> Fit
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

import numpy as np

from wsnsim.base.errors import UsageError
from wsnsim.fitting.data_files import ReadingOptions, read_nodes, read_sample
from wsnsim.fitting.estimation import FitOptions, fit_sample
from wsnsim.fitting.fitted_law import Evaluation, figures
from wsnsim.fitting.laws import LawForm
from wsnsim.fitting.located_readings import LocatedReadings
from wsnsim.fitting.result import Fit

SAME_SHARE: Final = 0.5
"""A test file with a larger share of its readings in the train files counts as one of them."""


def fit_readings(
    files: Sequence[str],
    nodes: str,
    form: LawForm,
    test: Sequence[str] = (),
    reading: ReadingOptions | None = None,
    options: FitOptions | None = None,
) -> Fit:
    """Fit a law to the readings of all files and judge it on the test files.

    Without test files, and with `in_sample`, it is judged on the files that it was fitted to.

    Raises:
        UsageError: a test file is one of the train files, and `in_sample` is not said.
        RunError: a file cannot be used, or the readings do not determine the law.
    """
    how, wanted = reading or ReadingOptions(), options or FitOptions()
    table = read_nodes(nodes, how.columns)
    every = read_sample([*files, *test], table, form, how)
    train = every.of(range(len(files)))
    judged = [every.of([index]) for index in range(len(files), len(every.files))]
    if not test and wanted.in_sample:
        judged = [every.of([index]) for index in range(len(files))]
    shared = [_shares(sample, train) for sample in judged]
    for sample, same in zip(judged, shared, strict=True):
        if same and not wanted.in_sample:
            raise UsageError(_refusal(sample, train))
    fitted = fit_sample(train, form, wanted)
    test_rows = (
        Evaluation(sample.files[0], same, figures(fitted.model, sample), figures(fitted.plain, sample))
        for sample, same in zip(judged, shared, strict=True)
    )
    return dataclasses.replace(fitted, test=tuple(test_rows))


def _shares(sample: LocatedReadings, train: LocatedReadings) -> bool:
    """Whether a file is one of the train files: by its content, or by most of its readings."""
    if sample.files[0].digest in {file.digest for file in train.files}:
        return True
    known = set(_keys(train))
    return float(np.mean([key in known for key in _keys(sample)])) > SAME_SHARE


def _keys(sample: LocatedReadings) -> list[tuple[float, int, float]]:
    """Time, node and value of each reading."""
    return list(zip(sample.times.tolist(), sample.nodes.tolist(), sample.readings.tolist(), strict=True))


def _refusal(sample: LocatedReadings, train: LocatedReadings) -> str:
    named = next((file.path for file in train.files if file.digest == sample.files[0].digest), "the train files")
    return (
        f"{sample.files[0].path} has the same readings as {named}: a law must not be judged on what it was fitted to; "
        "give another file with --test, or say --in-sample"
    )
