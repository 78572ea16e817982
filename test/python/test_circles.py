"""No files and no folders of the package import each other."""

import importlib.machinery
import importlib.util

from conftest import ROOT


def test_nothing_imports_each_other():
    path = str(ROOT / ".ci" / "circles")
    loader = importlib.machinery.SourceFileLoader("circles", path)
    script = importlib.util.module_from_spec(importlib.util.spec_from_loader("circles", loader))
    loader.exec_module(script)
    files, folders = script.found()
    assert (files, folders) == ([], [])
