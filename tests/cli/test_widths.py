"""What commands print has 100 columns, however long names are and however many points there are."""

from __future__ import annotations

from pathlib import Path

import pytest

from wsnsim.campaign import engines
from wsnsim.cli import main

from ..campaign.inline_engine import InlineEngine

pytestmark = pytest.mark.usefixtures("fresh_folder")
NAME = "a_name_of_a_scenario_that_is_as_long_as_some_people_make_them_to_say_it_all"
SHORT = f"{{extends: pso_mhpf, name: {NAME}, duration: 0.4 s, tracker: {{particles: 20}}}}"
VARIED = "tracker.particles=20,21,22,23,24,25"


@pytest.mark.parametrize(
    "command",
    [
        "info run.h5",
        "info campaign",
        "trace run.h5 --step 5",
        "diff run.h5 run.h5",
        "compare campaign --explain --bound",
        "sweep campaign --metric energy",
        "list",
        "list scenarios",
        "list datasheets",
        "info pso_mhpf",
    ],
)
def test_no_line_is_wider_than_100_columns(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engines, "LocalEngine", InlineEngine)
    Path("long.yaml").write_text(SHORT)
    assert main(["run", "long.yaml", "-q", "-o", "run.h5"]) == 0
    if "campaign" in command:
        assert main(["sweep", "long.yaml", "--vary", VARIED, "--replicates", "2", "-q", "-o", "campaign"]) == 0
    assert main(command.split()) == 0
    said = capsys.readouterr().out.splitlines()
    assert said and [line for line in said if len(line) > 100] == []
