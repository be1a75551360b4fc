"""Provenance says what made a result, and nothing about who or where."""

from __future__ import annotations

import getpass
import json
import shutil
import socket
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

import wsnsim
from tests.helpers.git import git
from wsnsim.recording.provenance import SETTINGS, _checkout, cpu_features, provenance


def test_it_names_versions_seed_command_and_start():
    made = provenance("wsnsim run x.yaml", 7, ["mylab 1.0"])
    assert (made["command_line"], made["seed"], made["plugins"]) == ("wsnsim run x.yaml", 7, ["mylab 1.0"])
    assert made["packages"]["numpy"] == np.__version__
    assert made["packages"]["wsnsim"]
    assert None not in made["packages"].values()
    assert datetime.fromisoformat(made["start"]).utcoffset().total_seconds() == 0
    assert json.loads(json.dumps(made)) == made


@pytest.mark.parametrize("name", SETTINGS)
def test_features_differ_where_a_setting_chooses_other_machine_code(name, monkeypatch):
    for each in SETTINGS:
        monkeypatch.delenv(each, raising=False)
    plain = cpu_features.__wrapped__()
    monkeypatch.setenv(name, "generic")
    assert cpu_features.__wrapped__() == (*plain, f"{name}=generic"), "the processor itself is named too"


def test_it_holds_no_path_user_or_host():
    text = json.dumps(provenance("", 0))
    home, root = Path.home(), Path(wsnsim.__file__).parents[1]
    assert str(root) not in text
    assert len(str(home)) < 2 or str(home) not in text
    assert socket.gethostname() not in text or len(socket.gethostname()) < 4
    assert f'"{getpass.getuser()}"' not in text


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
def test_a_checkout_gives_its_commit_and_whether_it_was_changed(tmp_path, monkeypatch):
    """Also in a hook of another repository, where variables of git name that one."""
    monkeypatch.setenv("GIT_DIR", str(tmp_path / "another"))
    monkeypatch.setenv("GIT_INDEX_FILE", str(tmp_path / "index"))
    assert _checkout(tmp_path) is None
    git(tmp_path, "init", "-q")
    assert _checkout(tmp_path) is None
    (tmp_path / "code.py").write_text("a = 1\n")
    git(tmp_path, "add", ".")
    who = ["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]
    git(tmp_path, *who, "commit", "-q", "-m", "first")
    commit = git(tmp_path, "rev-parse", "HEAD").stdout.strip()
    (tmp_path / "untracked").write_text("")
    assert _checkout(tmp_path) == {"commit": commit, "dirty": False}
    (tmp_path / "code.py").write_text("a = 2\n")
    assert _checkout(tmp_path) == {"commit": commit, "dirty": True}


def test_without_git_there_is_no_commit_and_no_fault(tmp_path, monkeypatch):
    (tmp_path / ".git").mkdir()
    monkeypatch.setenv("PATH", "")
    assert _checkout(tmp_path) is None
