"""The documents say what is so."""

import doctest
import importlib
import re
from pathlib import Path

import pytest
import reference

import splatweaver

ROOT = Path(__file__).parents[4]
PAGES = [ROOT / "docs/python.md", ROOT / "crates/app/py/README.md"]


def test_the_page_is_that_of_the_docstrings():
    written = (ROOT / "docs/reference/python.md").read_text(encoding="utf-8")
    assert written == reference.page(), "python crates/app/py/tests/reference.py > docs/reference/python.md"


def test_everything_public_is_on_the_page():
    named = set(reference.FUNCTIONS + reference.CLASSES + reference.ERRORS + ["Progress", "Meta", "set_threads", "__version__"])
    assert named == set(splatweaver.__all__)


@pytest.mark.parametrize("module", ["_rasterization", "_scene", "_cameras", "_commands", "_runs"])
def test_examples_in_docstrings_run(module):
    found = doctest.testmod(importlib.import_module(f"splatweaver.{module}"))
    assert found.failed == 0


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_examples_of_pages_compile(page):
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    assert blocks
    for block in blocks:
        compile(block, str(page), "exec")
