"""Every example of the documentation does what its page says."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.documentation.executed_pages import ROOT, ExampleError, blocks, commands, run_page

FOLDERS = ("tutorials", "how-to", "explanation")
PAGES = [ROOT / "README.md", *(page for name in FOLDERS for page in sorted((ROOT / "docs" / name).glob("*.md")))]


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


def test_a_command_goes_on_in_the_next_line_after_a_backslash():
    (block,) = blocks("```console\n$ wsnsim run x \\\n    --quiet\nsaid\n```\n")
    (command,) = commands(block)
    assert (command.text, command.printed, command.line) == ("wsnsim run x \\\n    --quiet", ["said"], 2)
