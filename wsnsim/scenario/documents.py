"""YAML documents other than scenarios, read and checked in the same way: every issue has its file, line and column.

read_document(path, model) -> Document        DocumentModel: the base class of the models
validated(values, model)                      the same of values that a program gives
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from wsnsim.base.errors import Issue, ScenarioError
from wsnsim.scenario.files import content_of
from wsnsim.scenario.located_values import Keys, LocatedValue, Origin, dotted, plain, spot_of
from wsnsim.scenario.messages import issues_of
from wsnsim.scenario.reader import read


class DocumentModel(BaseModel):
    """Declared keys of a mapping; any other key is an issue."""

    model_config = ConfigDict(extra="forbid", frozen=True)


M = TypeVar("M", bound=DocumentModel)


@dataclass(frozen=True)
class Document(Generic[M]):
    """A checked document and where its values stand."""

    content: M
    root: LocatedValue

    def issue(self, path: Keys, message: str) -> Issue:
        """An issue of the value at a path of keys."""
        return spot_of(self.root, path).issue(path, message)


def read_document(path: Path, model: type[M], name: str = "") -> Document[M]:
    """The document in a YAML file, checked against a model; issues call the file by `name`, by default its own.

    Raises:
        ScenarioError: every issue found, each at its place.
    """
    content, issues = content_of(path)
    if content is None:
        raise ScenarioError(issues)
    root, issues = read(content, Origin(name or path.name, path.parent, tuple(content.splitlines())))
    if root is None or issues:
        raise ScenarioError(issues)
    try:
        return Document(model.model_validate(plain(root)), root)
    except ValidationError as error:
        raise ScenarioError(issues_of(error, model, root)) from None


def validated(values: Mapping[str, Any], model: type[M]) -> M:
    """The document with these values. Raises ValueError with its first issue."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ValueError(f"{dotted(first['loc'])}: {first['msg']}") from None
