"""The chain as a user joins it: check, fit, compare, diagnose, refit, held-out rows, export.

Each step ends in a result or in a refusal whose advice, typed as printed, works. A walk goes
through all steps with one table and one base, and says what did not hold.
"""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ecm.io.arrays import B, F
from ecm.io.columns import POSE, WRENCH
from ecm.io.table import Table, read_table
from ecm.models import Model, load_model
from ecm.models.partial import measured_part
from ecm.workflow.app.steps import Files, command_of
from support.exports import CompiledC
from support.neck import ROOT, SHARED_DATA, Command, Done, csv_text

BASES = ("linear", "cubic", "choose", "energy4", "energy5", "energy6", "physics", "rod")
TARGETS = ("c", "rust", "mujoco", "drake", "ros2", "fmu", "opensim", "simulink", "pinocchio")
_PROMISED = 1.05
"""A promised error may be missed by this factor."""
_WORSE = 1.1
_MOST_EXPORTED = 1.2
"""Error of the compiled model from `predict` at the measured rows, over the noise."""
TEMPLATES = ROOT / "python" / "ecm" / "io" / "templates"
_FOLDS = 4
"""Every so many poses are held out."""


def neck(folder: Path) -> Path:
    """The shipped campaign of the neck, a payload hidden."""
    return _copied(ROOT / "examples" / "neck_measured.csv", "neck_measured.toml", folder)


def neck_of_few_rows(folder: Path) -> Path:
    """Twenty rows of it."""
    path = neck(folder)
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(lines[:21]) + "\n", encoding="utf-8")
    return path


def neck_of_forces(folder: Path) -> Path:
    """Its three forces, no torque: a sensor of three axes."""
    path = neck(folder)
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]
    kept = [j for j, name in enumerate(rows[0]) if name not in WRENCH[3:]]
    text = "\n".join(",".join(row[j] for j in kept) for row in rows)
    path.write_text(text + "\n", encoding="utf-8")
    return path


def six_axes(folder: Path) -> Path:
    """The shipped table of six axes."""
    return _copied(TEMPLATES / "data.csv", "data.toml", folder)


def three_axes(folder: Path) -> Path:
    """The shipped table of three axes."""
    return _copied(TEMPLATES / "data_3.csv", "data_few.toml", folder)


def one_axis(folder: Path) -> Path:
    """The shipped table of one axis."""
    return _copied(TEMPLATES / "data_1.csv", "data_few.toml", folder)


def one_axis_with_a_second_load(folder: Path) -> Path:
    """A piston: displacement, force and a pressure that adds to it; dry friction of sliders."""
    random = np.random.default_rng(5)
    n = 160
    x = 0.01 * np.sin(np.linspace(0.0, 8.0 * np.pi, n)) * random.uniform(0.5, 1.0, n)
    pressure = 2e5 * (1.5 + np.sin(np.linspace(0.0, 5.0, n)))
    force = 900.0 * x + 2e6 * x**3 - 1.2e-4 * pressure + _sliders(x, 2.0, 1.5e-3)
    force += 0.05 * random.standard_normal(n)
    columns = {"x_m": x, "fx_N": force, "supply_1_Pa": pressure, "time_s": np.arange(n) * 2.0}
    return _written(columns, "[instrument]\nforce_sd_N = 0.05\npose_position_sd_m = 1e-6\n", folder)


def planar_of_known_length(folder: Path) -> Path:
    """A rod in a plane, three axes and its length: it grows with the warmth of the room."""
    random = np.random.default_rng(8)
    n, length = 90, 0.1
    x, y, turn = (random.uniform(-most, most, n) for most in (4e-3, 15e-3, 0.3))
    warmer = 5.0 * np.sin(np.arange(n) / 11.0) + random.normal(0.0, 0.3, n)
    c = x - length * 3e-4 * warmer
    wrench = np.c_[
        9e3 * c + 3e4 * y**2, 700.0 * y - 25.0 * turn + 6e4 * y * c, -25.0 * y + 2.2 * turn
    ]
    wrench[:, 2] += 3e4 * y**2 * turn
    wrench += random.standard_normal((n, 3)) * [0.15, 0.08, 0.004]
    columns = {"x_m": length + x, "y_m": y, "theta_z_rad": turn}
    columns |= dict(zip(("fx_N", "fy_N", "tau_z_Nm"), wrench.T, strict=True))
    columns |= {"time_s": 20.0 * np.arange(n), "temperature_degC": 22.0 + warmer}
    return _written(columns, f"[mechanism]\nlength_m = {length}\n", folder)


def rotation_only(folder: Path) -> Path:
    """A joint: three angles and three torques, softening as it is turned further each time."""
    random = np.random.default_rng(6)
    n = 120
    theta = random.uniform(-0.4, 0.4, (n, 3)) * np.linspace(0.4, 1.0, n)[:, None]
    torque = theta * [2.0, 3.0, 3.0] * (1.0 + 0.8 * (theta**2).sum(axis=1))[:, None]
    torque *= (1.0 - 0.05 * np.linspace(0.0, 1.0, n) ** 0.5)[:, None]
    torque += 0.004 * random.standard_normal((n, 3))
    columns = dict(zip(POSE[3:], theta.T, strict=True)) | dict(
        zip(WRENCH[3:], torque.T, strict=True)
    )
    columns["time_s"] = np.arange(n) * 10.0
    noise = "[instrument]\ntorque_sd_Nm = 0.004\npose_rotation_sd_rad = 1e-5\n"
    return _written(columns, noise, folder)


def log_of_one_axis(folder: Path) -> Path:
    """A log with time: a strip stretched at two speeds, two relaxing branches behind it."""
    random = np.random.default_rng(7)
    time = np.arange(0.0, 60.0, 0.1)
    speed = np.where(time < 30.0, 1.0, 0.25)
    x = 0.01 * np.sin(2.0 * np.pi * np.cumsum(speed) * 0.1 / 6.0)
    force = 800.0 * x + 3e6 * x**3
    for stiffness, tau in ((300.0, 0.7), (150.0, 6.0)):
        branch = np.zeros(len(x))
        for i in range(1, len(x)):
            branch[i] = branch[i - 1] * np.exp(-0.1 / tau) + stiffness * (x[i] - x[i - 1])
        force = force + branch
    force = force + 0.02 * random.standard_normal(len(x))
    return _written(
        {"time_s": time, "x_m": x, "fx_N": force}, '[file]\nkind = "continuous"\n', folder
    )


def finger_joint(folder: Path) -> Path:
    """The published measurements of a finger joint, with the shipped description."""
    source = SHARED_DATA / "finger_joint" / "03April2018_full_calculated_data.csv"
    return _copied(source, ROOT / "examples" / "finger_joint.toml", folder)


TABLES: dict[str, Callable[[Path], Path]] = {
    function.__name__: function
    for function in (
        neck,
        neck_of_few_rows,
        neck_of_forces,
        six_axes,
        three_axes,
        one_axis,
        one_axis_with_a_second_load,
        planar_of_known_length,
        rotation_only,
        log_of_one_axis,
        finger_joint,
    )
}
"""Every kind of table, by name."""


def _sliders(x: F, force: float, reach: float) -> F:
    """(N,) force of five elastic sliders in parallel (Prandtl-Ishlinskii), N."""
    limits = force * np.linspace(0.2, 1.0, 5) / 3.0
    state, total = np.zeros(5), np.zeros(len(x))
    for i in range(1, len(x)):
        state = np.clip(state + limits / reach * (x[i] - x[i - 1]), -limits, limits)
        total[i] = state.sum()
    return total


def _copied(table: Path, description: Path | str, folder: Path) -> Path:
    """Copies under one name; a description without a folder lies beside its table."""
    path = folder / "data-1.csv"
    shutil.copyfile(table, path)
    shutil.copyfile(table.parent / description, path.with_suffix(".toml"))
    return path


def _written(columns: dict[str, F], description: str, folder: Path) -> Path:
    path = folder / "data-1.csv"
    path.write_text(csv_text(columns), encoding="utf-8")
    path.with_suffix(".toml").write_text(description, encoding="utf-8")
    return path


@dataclass
class Walk:
    """One way through the chain; `broken` says what did not hold.

    Parameters
    ----------
    command
        Runs `ecm ARGUMENTS` in the folder of the table.
    table, base
        Names among `TABLES` and `BASES`.
    folder
        The working folder: an empty one, and the current one.
    by_page
        Take the command lines from the requests of the page, where it has the step.
    most
        Effects of the ranking that are added.
    targets
        Targets of export.
    """

    command: Command
    table: str
    base: str
    folder: Path
    by_page: bool = False
    most: int = 12
    targets: tuple[str, ...] = TARGETS
    broken: list[str] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    """Refusals, each with the advice that worked."""
    steps: int = 0

    def run(self) -> Walk:
        """Go through all steps."""
        path = TABLES[self.table](self.folder)
        data = path.name
        if self._step("check", {}, ["check", data], Files([data])) is None:
            return self
        files = Files([data])
        if not self._fit(data, files):
            return self
        files = Files([data], model="model-1.json")
        report = ["--json", "compare-1.json"]
        self._step("compare", {}, ["compare", "model-1.json", data, *report], files)
        found = self._diagnosis(data, files)
        self._exports("model-1.json")
        if found is not None:
            added = self._additions(data, found)
            if added:
                self._exports(added)
        return self

    @cached_property
    def rows(self) -> Table:
        """The table that the chain goes through."""
        return read_table("data-1.csv")

    def _fit(self, data: str, files: Files) -> bool:
        argv = ["fit", data, "--model", self.base, "--out", "model-1.json", "--json", "fit-1.json"]
        return (
            self._step("fit", {"model": self.base}, argv, files, makes="model-1.json") is not None
        )

    def _diagnosis(self, data: str, files: Files) -> dict[str, Any] | None:
        argv = ["diagnose", "model-1.json", data, "--json", "found-1.json"]
        if self.by_page:
            argv += ["--report", "found-1.html", "--next", "next-1.csv"]
        if self._step("diagnose", {}, argv, files) is None:
            return None
        found: dict[str, Any] = json.loads(Path("found-1.json").read_text(encoding="utf-8"))
        # A wrong statement of the table is said in its own words: nothing of the body is missing.
        missing = "Missing:" in found["sentence"]
        if missing != (found["verdict"] != "none" and not (found["unknown"] or {}).get("misread")):
            self.broken.append(f"verdict {found['verdict']}, but: {found['sentence']}")
        self._summary(found)
        if found["model"]["as_given"]["over_noise"] is not None:
            compared = json.loads(Path("compare-1.json").read_text(encoding="utf-8"))
            said = found["model"]["as_given"]["over_noise"]
            other = compared.get("whitened_rms", said)
            if abs(said - other) > 0.02 * other:
                self.broken.append(f"diagnose says {said:.4g} times the noise, compare {other:.4g}")
        return found

    def _summary(self, found: dict[str, Any]) -> None:
        """The three lines must say what the rest of the report says."""
        lines, named = found["summary"], found["verdict"] in ("named", "ambiguous")
        first = [members[0] in lines["missing"] for members in found["answer"]]
        if named and not all(first):
            self.broken.append(f"{found['answer']} is found, but: {lines['missing']}")
        for part in (found.get("addition", {}), found["model"]):
            command = (part.get("remedy") or {}).get("command")
            if command:
                if not lines["add"].startswith(command):
                    self.broken.append(f"{command} is advised, but: {lines['add']}")
                return

    def _additions(self, data: str, found: dict[str, Any]) -> str:
        """Add what is named and each effect of the ranking; the promise must be reached.

        Returns the file of the model with what is named; empty where there is none.
        """
        added, named = "", found.get("addition")
        if named is not None and named["remedy"] is not None and named["remedy"]["command"]:
            argv = shlex.split(named["remedy"]["command"])[1:]
            done = self._run([*argv, "--json", "named.json"])
            if done.code != 0:
                self.broken.append(f"diagnose advised {shlex.join(argv)}: {done.err[-300:]}")
            else:
                added = argv[argv.index("--out") + 1]
            if added and not named["refused"] and named["held_out"]["after"] is not None:
                document = json.loads(Path("named.json").read_text(encoding="utf-8"))
                reached = document["history"][-1]["held_out"]
                promised = named["held_out"]["after"]
                if reached > _PROMISED * promised:
                    self.broken.append(f"promised {promised:.3g}, reached {reached:.3g}: {argv}")
        for item in found["ranking"][: self.most]:
            self._add(data, item["id"])
        return added

    def _add(self, data: str, effect: str) -> None:
        out = f"with-{effect}.json"
        argv = ["refit", "model-1.json", data, "--add", effect, "--out", out]
        done = self._run([*argv, "--json", "refit-1.json"])
        self.steps += 1
        if done.code != 0:
            self._advice(argv, done, "refit-1.json", makes=out)
        elif effect not in load_model(out).name and "other-shape" not in out:
            self.broken.append(f"{out}: no {effect} in it")
        else:
            self._held_out(effect)

    def _held_out(self, effect: str) -> None:
        """On rows that neither saw, the model with the effect must not be worse."""
        groups = np.unique(self._groups(), return_inverse=True)[1]
        # In a random order: every fourth row of a cycle is always the same part of it.
        order = np.random.default_rng(0).permutation(groups.max() + 1)
        test = order[groups] % _FOLDS == 1
        if test.sum() < 4 or (~test).sum() < 8:
            return
        train = self.rows.select(np.flatnonzero(~test))
        train.write(Path("train.csv"))
        fit = self._run(["fit", "train.csv", "--model", self.base, "--out", "train.json"])
        if fit.code != 0:
            return
        argv = ["refit", "train.json", "train.csv", "--add", effect, "--out", "train2.json"]
        if self._run(argv).code != 0:
            return
        before, after = (self._error(name, test) for name in ("train.json", "train2.json"))
        if after > _WORSE * before + 1.0:
            self.broken.append(
                f"{effect} was added, and errs {after:.3g} times the noise on rows held out, "
                f"before {before:.3g}"
            )

    def _groups(self) -> F:
        if self.rows.has("pose_id"):
            return self.rows.column("pose_id")
        return np.arange(len(self.rows)) // max(1, len(self.rows) // 24)

    def _error(self, model: str, test: B) -> float:
        """Root mean square error of the worst component over the noise, on some of the rows.

        Predicted along all rows: what has happened before a row is part of its state.
        """
        found = self._measured(load_model(model), self.rows)
        error = self.rows.matrix(found.outputs) - found.predict(self.rows, skip_untestable=True)
        scored = error[test & self.rows.of_poses]
        rows = self.rows.select(np.flatnonzero(test)).measured()
        return float((np.sqrt((scored**2).mean(axis=0)) / self._noise(found, rows)).max())

    @staticmethod
    def _measured(model: Model, rows: Table) -> Model:
        """The wrench columns of a model that the rows have."""
        return replace(model, base=measured_part(model.base, rows))

    @staticmethod
    def _noise(found: Model, rows: Table) -> F:
        """(m,) noise of the model's rows; a twentieth of the spread where none is known."""
        if found.noise.is_residual:
            return np.maximum(rows.matrix(found.outputs).std(axis=0) / 20.0, 1e-12)
        at = found.rows_at(rows.matrix(found.inputs))
        variance = np.einsum("njj->nj", found.noise.covariance(at)).mean(axis=0)
        return np.asarray(np.maximum(np.sqrt(variance), 1e-12))

    def _exports(self, model: str) -> None:
        for target in self.targets:
            out = f"export-{target}-{Path(model).stem}"
            argv = ["export", model, "--to", target, "--out", out]
            if self.by_page and model == "model-1.json" and target in ("c", "rust", "mujoco"):
                files = Files(["data-1.csv"], model=model)
                argv = command_of("export", {"to": target}, files, 1).argv[:-2]
                out = argv[argv.index("--out") + 1]
                shutil.rmtree(out, ignore_errors=True)
            done = self._run([*argv, "--json", "export-1.json"])
            self.steps += 1
            if done.code != 0:
                self._advice(argv, done, "export-1.json", makes=out)
            elif target == "c":
                self._compiled(model, Path(out))

    def _compiled(self, model: str, folder: Path) -> None:
        """The compiled model must give at the measured rows what `predict` gives there."""
        found, code = load_model(model), CompiledC(folder.resolve() / "ecm_model.c")
        rows = self.rows.measured()
        poses = np.ascontiguousarray(rows.matrix(found.inputs))
        expected, got = found.predict(poses), code.wrenches(poses, len(found.outputs))
        there = [j for j, name in enumerate(found.outputs) if rows.has(name)]
        noise = self._noise(self._measured(found, rows), rows)
        over = (np.sqrt(((got - expected)[:, there] ** 2).mean(axis=0)) / noise).max()
        if not over <= _MOST_EXPORTED:
            self.broken.append(f"{folder}: C errs {over:.3g} times the noise from predict")

    def _step(
        self,
        verb: str,
        request: dict[str, Any],
        argv: list[str],
        files: Files,
        makes: str = "",
    ) -> Done | None:
        """One step; None where it ended in a refusal from which nothing leads on."""
        if self.by_page:
            argv = command_of(verb, request, files, 1).argv
        done = self._run(argv)
        self.steps += 1
        if done.code == 0:
            return done
        report = argv[argv.index("--json") + 1] if "--json" in argv else ""
        return done if self._advice(argv, done, report, makes=makes) else None

    def _advice(self, argv: list[str], done: Done, report: str, makes: str) -> bool:
        """Whether a refusal names a command, and the command works; else it must say why not."""
        said = done.err.strip()
        at = said.rfind("error: ")
        if at < 0 or "something unexpected" in said:
            self.broken.append(f"{shlex.join(argv)}: {said[-400:]}")
            return False
        remedy = None
        if report and Path(report).exists():
            document = json.loads(Path(report).read_text(encoding="utf-8"))
            remedy = document.get("error", {}).get("remedy")
        if remedy is None:
            self.broken.append(f"{shlex.join(argv)}: refused without a way out: {said[at:][:400]}")
            return False
        if not remedy["command"]:
            self.refused.append(f"{shlex.join(argv)}: {remedy['words']}")
            return False
        for part in remedy["command"].split(" && "):
            typed = shlex.split(part)
            again = self._run(typed[1:])
            if typed[0] != "ecm" or again.code != 0:
                self.broken.append(f"advised {part}: {again.err[-300:]}")
                return False
        self.refused.append(f"{shlex.join(argv)}: {remedy['command']}")
        return not makes or Path(makes).exists()

    def _run(self, argv: list[str]) -> Done:
        return self.command(*argv)


def walks() -> Iterator[tuple[str, str]]:
    """Every table with every base that may fit it."""
    for table in TABLES:
        for base in BASES:
            yield table, base
