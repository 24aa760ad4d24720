"""Every code block of README.md but the two commands runs, in order, in one folder.

```python            executed; a ```text block right after it is its exact output
```python NAME       written to NAME
```sh                executed line by line with the package's commands
```toml NAME         written to NAME
```csv NAME          written to NAME
```text              only right after a block that prints, or it is refused
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from ecm.models import PhysicsMap
from support.jobs import copy_cases
from support.neck import ROOT
from support.pages import blocks, follow


@pytest.mark.parametrize("page", ["README.md"])
def test_the_blocks_of_the_page_run(
    page: str, tmp_path: Path, quick_job: Path, neck_physics: PhysicsMap
) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    copy_cases(quick_job, tmp_path / "simulated.parts")  # `ecm simulate` goes on from them
    found = [b for b in blocks(ROOT / page) if "make demo" not in b.text]
    assert found
    follow(found, page, tmp_path)
