"""A case of the fuzz test, and what a command may do with it.

    faults(case, folder) -> ["a sentence", ...]      empty if the command behaved

A case is a command line and the files that it finds in its folder, so that every case can be kept and replayed.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import io
import json
import os
import re
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import h5py
import pytest

from tests.fuzz.properties import broken, made
from wsnsim.base.errors import WsnsimError
from wsnsim.cli import main

EXIT_CODES: Final = (0, 1, 2, 3, 129, 130, 141, 143)
"""The documented ones, see the README."""
FORBIDDEN: Final = ("internal error", "Traceback (most recent call last)")
FRAME: Final = re.compile(r'^  File "', re.MULTILINE)
PROPERTIES: Final = "properties"
"""In place of a command: the file x.json is a scenario, whose run is checked for what must hold in every run."""


@dataclass(frozen=True)
class Case:
    """A command line in a folder of files.

    Attributes:
        arguments: the command line without `wsnsim`, or (PROPERTIES,).
        files: content of the files by name.
        known: the reason why the case still fails; '' if it must not.
        names: a word in small letters that the message of an error must hold; '' for none.
        fragile: whether libhdf5 may end the process: see `docs/security.md`.
    """

    arguments: tuple[str, ...]
    files: dict[str, bytes] = field(default_factory=dict)
    known: str = ""
    names: str = ""
    fragile: bool = False

    def text(self) -> str:
        """The case as JSON. Files that are no text are in base64."""
        files = {name: _written(content) for name, content in self.files.items()}
        more = {name: value for name in ("known", "names", "fragile") if (value := getattr(self, name))}
        return json.dumps({"arguments": self.arguments, "files": files, **more}, indent=1) + "\n"

    @property
    def name(self) -> str:
        """A name for the case's file."""
        return f"{self.arguments[0]}-{hashlib.sha256(self.text().encode()).hexdigest()[:10]}"


def case_of(text: str) -> Case:
    """The case of a JSON text."""
    values = json.loads(text)
    files = {name: _content(written) for name, written in values["files"].items()}
    more = {name: values[name] for name in ("known", "names", "fragile") if name in values}
    return Case(tuple(values["arguments"]), files, **more)


def _written(content: bytes) -> str | dict[str, str]:
    with contextlib.suppress(UnicodeDecodeError):
        return content.decode("utf-8")
    return {"base64": base64.b64encode(content).decode()}


def _content(written: str | dict[str, str]) -> bytes:
    return written.encode("utf-8") if isinstance(written, str) else base64.b64decode(written["base64"])


def faults(case: Case, folder: Path) -> list[str]:
    """What is wrong with what the command does with a case in an empty folder."""
    if case.arguments == (PROPERTIES,):
        return _faults_of_run(json.loads(case.files["x.json"]))
    for name, content in case.files.items():
        (folder / name).write_bytes(content)
    said = io.StringIO()
    with _alone(folder), contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            code: Any = main(list(case.arguments))
        except BaseException as error:
            return [f"raised {type(error).__name__}: {error}"]
    return [*_faults_of_answer(case, code, said.getvalue()), *_faults_of_files(case, folder)]


def _faults_of_run(values: dict[str, Any]) -> list[str]:
    try:
        return broken(made(values))
    except WsnsimError as error:
        wrong = next((word for word in ("Error: ", "Exception: ") if word in str(error)), "")
        return [f"the run failed: {error}"] if wrong else []
    except Exception as error:
        return [f"raised {type(error).__name__}: {error}"]


def _faults_of_answer(case: Case, code: Any, said: str) -> Iterator[str]:
    if code not in EXIT_CODES:
        yield f"exit code {code!r}"
    if code and not said.strip():
        yield f"exit code {code} and not a word"
    for words in FORBIDDEN:
        if words in said:
            yield f"said {said.strip()[-300:]!r}"
    if FRAME.search(said):
        yield "printed frames of a traceback"
    if case.names and code and case.names not in said.lower():
        yield f"did not name {case.names!r}: {said.strip()[-300:]!r}"
    wild = {character for character in said if not (character.isprintable() or character in "\n\t")}
    if wild:
        yield f"printed control characters {sorted(wild)!r}"


def _faults_of_files(case: Case, folder: Path) -> Iterator[str]:
    """Nothing temporary is left, and every new result is complete."""
    for path in sorted(folder.rglob("*")):
        if path.name in case.files or not path.is_file():
            continue
        if ".tmp" in path.name:
            yield f"left {path.name!r}"
        if path.suffix == ".h5":
            try:
                with h5py.File(path) as file:
                    complete = "provenance_json" in file and "runs" in file
            except OSError as error:
                complete, said = False, str(error)
                yield f"wrote {path.name!r}, which cannot be read: {said}"
            else:
                if not complete:
                    yield f"wrote {path.name!r}, which is not complete"


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """The working directory of a case, and everything that a command or a plug-in changes restored afterwards."""
    modules = set(sys.modules)
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.setattr(sys, "path", list(sys.path))
        patch.setattr(os, "environ", os.environ.copy())
        patch.setattr(sys, "dont_write_bytecode", True)
        patch.chdir(folder)
        yield
    for name in set(sys.modules) - modules:
        if Path(getattr(sys.modules[name], "__file__", None) or "/").is_relative_to(folder):
            del sys.modules[name]
