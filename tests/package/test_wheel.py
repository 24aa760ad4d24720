"""The wheel, built once, installs and works in a clean environment without a Rust toolchain."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
from pathlib import Path
from zipfile import ZipFile

from ecm.models import PhysicsMap
from support.jobs import copy_fem
from support.neck import ROOT
from support.programs import ended


def test_the_wheel_installs_and_identifies_without_rust(
    tmp_path: Path, quick_job: Path, quick_config: Path, neck_physics: PhysicsMap
) -> None:
    maturin = Path(sys.executable).parent / "maturin"
    subprocess.run(
        [maturin, "build", "--release", "--quiet", "--out", tmp_path / "dist"],
        cwd=ROOT,
        check=True,
        timeout=900,
    )
    (wheel,) = (tmp_path / "dist").glob("ecm_stiffness-*-cp310-abi3-*.whl")
    assert wheel.stat().st_size < 6e6  # three times that with the symbols of the core
    with ZipFile(wheel) as archive:
        files = set(archive.namelist())
    templates = {path.name for path in (ROOT / "python/ecm/io/templates").glob("*.*")}
    assert {"rig.toml", "config.toml", "arm.toml", "data.toml", "data.csv"} <= templates
    assert {f"ecm/io/templates/{name}" for name in templates} <= files
    assert {f"ecm/models/export/templates/control/control.{end}" for end in ("c", "rs")} <= files

    exports = ROOT / "python/ecm/models/export/templates"
    targets = {str(path.relative_to(ROOT / "python")) for path in exports.glob("*/*.*")}
    assert targets
    assert targets <= files

    clean = tmp_path / "clean"
    venv.create(clean)
    # Neither cargo nor this environment's packages are within reach.
    environment = {"PATH": f"{clean / 'bin'}:/usr/bin:/bin", "HOME": str(tmp_path)}
    environment["ECM_CACHE"] = os.environ["ECM_CACHE"]  # the FEM of the neck is made already
    for name in ("PIP_INDEX_URL", "PIP_CONFIG_FILE", "SSL_CERT_FILE", "PIP_EXTRA_INDEX_URL"):
        if name in os.environ:
            environment[name] = os.environ[name]
    pip = [sys.executable, "-m", "pip", "--python", clean / "bin" / "python"]
    subprocess.run(
        [*pip, "install", "--quiet", "--disable-pip-version-check", "--no-compile", wheel],
        check=True,
        timeout=600,
        env={**os.environ, "PYTHONPATH": ""},
    )
    copy_fem(quick_job, tmp_path / "out", without=16)  # the rest is left to the wheel
    command = (clean / "bin" / "ecm", "identify", quick_config, "--out", "out")
    done = ended(*command, cwd=tmp_path, env=environment)
    assert (tmp_path / "out" / "model.json").exists()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    own = json.loads((quick_job / "summary.json").read_text(encoding="utf-8"))
    assert summary["simulate"]["counts"] == own["simulate"]["counts"]
    assert summary["loop"]["diagnosis"]["answer"] == own["loop"]["diagnosis"]["answer"]
    # The plain install is light: the report is an extra, and the command says so.
    assert not (tmp_path / "out" / "report.html").exists()
    assert "(extra report)" in done.stdout + done.stderr
