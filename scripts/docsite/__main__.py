"""`PYTHONPATH=scripts python -m docsite [RUSTDOC]` builds the site into site/, as `make docs` does.

RUSTDOC is the folder that `cargo doc` wrote; it becomes site/rust.
"""

import shutil
import sys
from pathlib import Path

from docsite.build import build
from docsite.pages import ROOT

shutil.rmtree(ROOT / "site", ignore_errors=True)
shutil.copytree(build(ROOT / "target" / "docs"), ROOT / "site")
if len(sys.argv) > 1:
    shutil.copytree(Path(sys.argv[1]), ROOT / "site" / "rust")
