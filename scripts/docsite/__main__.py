"""`PYTHONPATH=scripts python -m docsite` builds the site into site/; `make docs` calls it."""

import shutil

from docsite.build import build
from docsite.pages import ROOT

shutil.rmtree(ROOT / "site", ignore_errors=True)
shutil.copytree(build(ROOT / "target" / "docs"), ROOT / "site")
