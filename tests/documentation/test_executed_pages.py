"""Every example of the documentation does what its page says."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.documentation import example_server
from tests.documentation.executed_pages import ROOT, ExampleError, blocks, commands, run_page

FOLDERS = ("docs/tutorials", "docs/how-to", "docs/explanation", "tests/documentation/owners")
PAGES = [ROOT / "README.md", ROOT / "docs/plugins.md"]
PAGES += [page for name in FOLDERS for page in sorted((ROOT / name).glob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_the_examples_of_a_page_do_what_it_says(page, tmp_path):
    folder = tmp_path / "work"
    folder.mkdir()
    run_page(page, folder)


PAGE = """# Page

```yaml
# file: folder/mine.yaml
name: mine
```

```console
$ python -c 'print("one   two"); print("three 3.14 s")'
one two
three ... s
$ sbatch never.sh
Submitted
```

```python
x = open("folder/mine.yaml").read()
```

```sh
exit 1
```

```python
assert x == "name: mine\\n"
```
"""


@pytest.fixture
def outcome(tmp_path):
    """outcome(text): how many examples of a page with this text were executed; raises what run_page raises."""
    (tmp_path / "work").mkdir()

    def run(text: str) -> int:
        page = Path(tmp_path, "page.md")
        page.write_text(text, encoding="utf-8")
        return run_page(page, tmp_path / "work")

    return run


def test_files_are_written_commands_compared_and_python_blocks_share_their_names(outcome):
    assert outcome(PAGE) == 3


@pytest.mark.parametrize(
    ("right", "wrong", "message"),
    [
        ("three ... s", "three ... m", r"page.md:9: \$ python(.|\n)*order:\nthree ... m"),
        ("one two\nthree ... s", "three ... s\none two", r"order:\none two"),
        ('print("one', 'prin("one', r"page.md:9: .*\nfails:(.|\n)*NameError"),
        ("== ", "!= ", "page.md:25: a Python block fails:(.|\n)*AssertionError"),
    ],
)
def test_a_difference_is_reported_with_page_line_and_command(outcome, right, wrong, message):
    with pytest.raises(ExampleError, match=message):
        outcome(PAGE.replace(right, wrong))


def test_a_command_may_fail_where_the_page_shows_the_error(outcome):
    page = "```console\n$ python -c 'raise SystemExit(\"x: error: no\")'\nx: error: no\nexit code 1\n```\n"
    assert outcome(page) == 1


def test_commands_that_need_a_module_run_where_it_is_installed(outcome):
    page = "```console numpy no_such_module\n$ wsnsim nothing\n```\n```console numpy\n$ head -1 page.md\n```\n"
    with pytest.raises(ExampleError, match=r"page.md:5: \$ head -1 page.md\nfails"):
        outcome(page)


def test_an_example_finds_nothing_that_another_page_has_changed_and_may_end_its_process(outcome):
    change = "import os, sys\nsys.modules['mine'], os.environ['MINE'] = sys, '1'"
    assert outcome(f"```python\n{change}\nassert 'mine' in sys.modules\n```\n") == 1
    with pytest.raises(ExampleError, match=r"page.md:2: .*\nthe Python process ended"):
        outcome(f"```python\n{change}\nos._exit(0)\n```\n")
    check = "import os, sys\nassert 'mine' not in sys.modules and 'MINE' not in os.environ"
    assert outcome(f"```python\n{check}\n```\n") == 1


def test_a_command_and_a_script_have_their_exit_code_arguments_and_folder(outcome):
    script = "import sys\nprint(sys.argv, __name__)\nprint(open('mine.py').read()[:10])\nsys.exit(4)"
    page = f"```python\n# file: mine.py\n{script}\n```\n"
    page += "```console\n$ python mine.py 'a b'\n['mine.py', 'a b'] __main__\nimport sys\nexit code 4\n"
    assert outcome(f"{page}$ wsnsim check none.yaml\n... none.yaml ...\nexit code 2\n```\n") == 2


def test_a_script_finds_the_modules_beside_it_and_the_variables_of_the_test_and_may_print_any_bytes(
    outcome, monkeypatch
):
    monkeypatch.setenv("MINE", "set by the test")
    script = "import os, sys, mate\nsys.stdout.buffer.write(b'\\xff ' + os.environ['MINE'].encode())"
    files = f"```python\n# file: sub/mate.py\n```\n```python\n# file: sub/mine.py\n{script}\n```\n"
    assert outcome(f"{files}```console\n$ python sub/mine.py\n\ufffd set by the test\n$ python\n```\n") == 2


def test_a_page_ends_though_a_command_has_left_a_process_running(outcome, tmp_path):
    script = "import os, time\nif os.fork():\n    print('left')\nelse:\n    time.sleep(20)\n    open('ended', 'w')"
    page = f"```python\n# file: mine.py\n{script}\n```\n```python\nx = 1\n```\n"
    assert outcome(f"{page}```console\n$ python mine.py\nleft\n```\n") == 2
    assert not (tmp_path / "work" / "ended").exists()


def test_a_server_that_ended_is_said_to_have_ended(monkeypatch):
    monkeypatch.setattr(example_server.sys, "executable", shutil.which("false"))
    ended = example_server.ExampleServer()
    with pytest.raises(RuntimeError, match=r"the example server ended \(code 1\)"):
        ended.end_page()


def test_a_command_goes_on_in_the_next_line_after_a_backslash():
    (block,) = blocks("```console\n$ wsnsim run x \\\n    --quiet\nsaid\n```\n")
    (command,) = commands(block)
    assert (command.text, command.printed, command.line) == ("wsnsim run x \\\n    --quiet", ["said"], 2)
