"""Each change of the page "Where do I change what" fits the sources, and concerns two files at most."""

import re
import shutil
import subprocess

import pytest

from conftest import ROOT

PAGE = ROOT / "docs" / "howto" / "change.md"
SECTIONS = re.split("^## (.*)\n", PAGE.read_text(), flags=re.M)[1:]
CHANGES = {
    name: "\n".join(re.findall("```diff\n(.*?)```", text, re.S)) for name, text in zip(*[iter(SECTIONS)] * 2)
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_change_fits_and_is_python(name, tmp_path):
    files = re.findall(r"^\+\+\+ b/(.*)$", CHANGES[name], re.M)
    assert 1 <= len(set(files)) <= 2
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / file).exists():
            shutil.copy(str(ROOT / file), str(tmp_path / file))
    apply = ["git", "apply", "-"]
    subprocess.run(apply, cwd=str(tmp_path), input=CHANGES[name], check=True, universal_newlines=True)
    for file in files:
        if file.endswith(".py"):
            compile((tmp_path / file).read_text(), file, "exec")
