"""A law is fitted to files of readings and judged on others: what is judged must not be in what was fitted.

fit_readings(files, nodes, form, test, reading, options) -> Fit
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from wsnsim.base.errors import UsageError
from wsnsim.fitting.data_files import ReadingOptions, read_nodes, read_sample
from wsnsim.fitting.estimation import FitOptions, fit_sample
from wsnsim.fitting.fitted_law import Evaluation, figures
from wsnsim.fitting.laws import LawForm
from wsnsim.fitting.located_readings import LocatedReadings, ReadingKeys
from wsnsim.fitting.result import Fit
from wsnsim.fitting.shared_rows import shared_with


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
        UsageError: a test file shares readings with a train file (`SAME_SHARE` of them), and `in_sample` is not said.
        RunError: a file cannot be used, or the readings do not determine the law.
    """
    how, wanted = reading or ReadingOptions(), options or FitOptions()
    table = read_nodes(nodes, how.columns)
    every = read_sample([*files, *test], table, form, how)
    train = every.of(range(len(files)))
    judged = [every.of([index]) for index in range(len(files), len(every.files))]
    if not test and wanted.in_sample:
        judged = [every.of([index]) for index in range(len(files))]
    known = {file.path: train.keys(index) for index, file in enumerate(train.files)}
    said = [_shared(sample, train, known) for sample in judged]
    for words in said:
        if words and not wanted.in_sample:
            raise UsageError(words)
    fitted = fit_sample(train, form, wanted)
    test_rows = (
        Evaluation(sample.files[0], bool(words), figures(fitted.model, sample), figures(fitted.plain, sample))
        for sample, words in zip(judged, said, strict=True)
    )
    return dataclasses.replace(fitted, test=tuple(test_rows))


def _shared(sample: LocatedReadings, train: LocatedReadings, known: Mapping[str, ReadingKeys]) -> str:
    """What a file shares with the train files, by its content or its rows; '' if it is independent of them."""
    (file,) = sample.files
    named = next((other.path for other in train.files if other.digest == file.digest), None)
    found = (named, 1.0) if named else shared_with(sample.keys(0), known)
    if found is None:
        return ""
    return (
        f"{file.path} and {found[0]} share {found[1]:.1%} of their readings: a law must not be judged on what it was "
        "fitted to; give another file with --test, or say --in-sample"
    )
