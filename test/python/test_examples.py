"""What pages of the documentation say that their commands print is what they print."""

import sys

import pytest

from conftest import ROOT, slow

sys.path.insert(0, str(ROOT / "docs"))
import examples

PAGE = """
```sh
echo "error   0.218 m after 3 runs" && echo "a" && echo "b, 12 ms"
```

Some text.

```text
%s
```
"""


@slow
@pytest.mark.parametrize("name", examples.PAGES)
def test_a_page_shows_what_its_commands_print(name):
    assert examples.checked(examples.DOCS / name) == []


@pytest.mark.parametrize(
    "shown,right",
    [
        ("error 0.218 m after 3 runs\na\nb, 12 ms", True),
        ("error   0.219 m after 3 runs\n...", True),  # processors round differently
        ("error   0.228 m after 3 runs\n...", False),
        ("error   0.218 m after 4 runs\n...", False),
        ("error   0.218 m after 3 runs\na", False),
        ("...\na\n...", True),
        ("a\n...", False),
        ("error ...\n...\nb, 12 ms", True),
        ("error 0.5 ...\n...\nb, 12 ms", False),
        ("error   0.218 m after 3 runs\nc\n...", False),
    ],
)
def test_a_page_that_shows_something_else_is_noticed_and_updated(shown, right, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(PAGE % shown)
    assert (examples.checked(page) == []) == right
    examples.checked(page, update=True)
    assert examples.checked(page) == []
    if right and "..." in shown:
        assert page.read_text().count("...") == (PAGE % shown).count("...")


def test_a_command_that_fails_is_named(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("```sh\nls nowhere\n```\n")
    with pytest.raises(RuntimeError, match="nowhere"):
        examples.checked(page)
