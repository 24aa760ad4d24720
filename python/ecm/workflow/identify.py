"""The main job: simulate, select, measure, identify; then the loop that users come for.

Each step is a stage: its result is kept under a hash of its settings and inputs, so an
interrupted run goes on where it was. Numbers go to `summary.json`, times to `times.json`: the
same seed gives the same bytes in the summary on any number of threads.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm._native import PolynomialModel, __version__
from ecm.comparison import compare
from ecm.designs import Design, diagnosable_plan, optimal_design, paper_plan
from ecm.errors import MissingExtra
from ecm.fem.simulate import Simulated, simulate
from ecm.io.arrays import F, I
from ecm.io.cache import Stage, hash_of, write_json
from ecm.io.table import Table, read_table
from ecm.models import Model, PhysicsMap, fit_model, load_model, physics_map
from ecm.models.physics.map import reach_of
from ecm.regression.blas import one_blas_thread
from ecm.report.page import require_report
from ecm.rig import HiddenTable, RigSettings
from ecm.workflow import paper_selection as selection
from ecm.workflow import paper_validation as validation
from ecm.workflow.campaign_files import campaign_table, require_free
from ecm.workflow.config import Config, read_config
from ecm.workflow.console import Console, Silent
from ecm.workflow.loop import run_loop

DESIGNS = ("d", "maximin")
_RIGS = {"quasi_static": "the simulated rig", "robot": "the simulated rig with its arm"}
_CLEAN = tuple(f"measured-{name}" for name in DESIGNS)
_LOOP = "measured-loop"
_TIMED_PAIRS = 100
_BUDGET = {"d": 300, "maximin": 50}  # a second; within 0.01 % of what the default finds here


@dataclass
class Job:
    """What all steps share."""

    config: Config
    out: Path
    seed: int
    threads: int
    console: Console
    stages_s: dict[str, float] = field(default_factory=dict)
    figures: dict[str, F] = field(default_factory=dict)

    def stage(self, name: str, *inputs: Any) -> Stage:
        """The stage of a step; its key holds seed, version and inputs."""
        return Stage(self.out / "stages", name, {"seed": self.seed, "version": __version__}, inputs)

    @contextmanager
    def step(self, name: str, title: str) -> Iterator[None]:
        """Announces a step and takes its time."""
        self.console.print(title)
        start = time.perf_counter()
        yield
        self.stages_s[name] = round(time.perf_counter() - start, 3)


@one_blas_thread()
def identify(
    config: Config | Path,
    out: Path,
    *,
    seed: int = 0,
    threads: int = 0,
    console: Console | None = None,
) -> dict[str, Any]:
    """The paper's three steps and the loop after them; returns the summary.

    Parameters
    ----------
    config
        Settings, or the TOML file that holds them.
    out
        Directory of the results.

    Writes `summary.json`, `times.json`, `model.json`, the tables as CSV and `report.html`
    (the last with the extra `report`) into `out`; goes on where an earlier run was.
    """
    if not isinstance(config, Config):
        config = read_config(config)
    config.check_job()
    if config.rig.rig.mode == "robot":
        from ecm.rig.arm.run import need_arm

        need_arm(out / "stages" / "anchors")
    clean = _without_hidden(config.rig)
    require_free(out, out / "stages", _CLEAN, clean, seed)
    require_free(out, out / "stages", (_LOOP,), config.rig, seed)
    job = Job(config, out, seed, threads, console or Silent())
    out.mkdir(parents=True, exist_ok=True)
    summary: dict[str, Any] = {
        "format": "ecm-identify",
        "version": 1,
        "program": __version__,
        "seed": seed,
        "mechanism": config.mechanism.to_dict(),
    }
    try:
        require_report()
    except MissingExtra as error:
        job.console.print(f"There will be no report.html: {error}")
    with job.step("simulate", "1 Simulate: FEM poses of random wrenches"):
        pairs = _simulate(job, summary)
    with job.step("select", "2 Select: a model, and the poses worth measuring"):
        train, test = _split(job, pairs)
        designs = _select(job, pairs, train, test, summary)
    with job.step("measure", f"3 Measure and identify: {_RIGS[config.rig.rig.mode]}"):
        campaigns = _measure(job, pairs, train, designs, summary)
        physics = _physics(job, pairs)
        _identify(job, campaigns, physics, summary)
    with job.step("loop", "4 The loop: an effect is hidden in the rig, and found again"):
        _loop(job, pairs, train, physics, summary)
    with job.step("time", "Evaluation time against FEM"):
        evaluation = _times(job, pairs, test)
    times = {"stages_s": job.stages_s, "evaluation": evaluation}
    write_json(out / "summary.json", summary)
    write_json(out / "times.json", times)
    _report(job, summary, times)
    return summary


# --- 1 simulate --------------------------------------------------------------


def _simulate(job: Job, summary: dict[str, Any]) -> Simulated:
    config = job.config
    pairs = simulate(
        config.mechanism,
        config.simulate.n,
        config.workspace,
        seed=job.seed,
        threads=job.threads,
        directory=job.out / "stages",
        progress=job.console.progress("FEM pairs"),
    )
    counts = pairs.counts
    job.console.print(
        f"  {counts['drawn']} wrenches drawn, {counts['screened']} passed the rod's screen, "
        f"{counts['solved']} solved, {counts['kept']} kept "
        f"({counts['unstable']} unstable, {counts['failed']} without a solution)"
    )
    rest = config.mechanism.fem().rest_stiffness()
    equation_11 = validation.against_equation_11(rest)
    job.console.print(
        "  K at rest against the paper's equation (11): "
        + ", ".join(f"{100.0 * row['difference']:+.1f} %" for row in equation_11)
    )
    summary["simulate"] = {
        "counts": counts,
        "iterations_mean": float(pairs.iterations.mean()),
        "largest_rotation_rad": float(np.linalg.norm(pairs.poses[:, 3:], axis=1).max()),
        "largest_stretch": float(pairs.largest_stretch.max()),
        "stiffness_at_rest": rest.tolist(),
        "equation_11": equation_11,
    }
    job.figures["simulated_poses"] = pairs.poses
    pairs.table().write(job.out / "simulated.csv")
    return pairs


def _split(job: Job, pairs: Simulated) -> tuple[I, I]:
    return selection.split(len(pairs), job.config.simulate.n_test, job.seed)


# --- 2 select ----------------------------------------------------------------


def _select(
    job: Job,
    pairs: Simulated,
    train_rows: I,
    test_rows: I,
    summary: dict[str, Any],
) -> dict[str, Design]:
    settings = job.config.select
    train = pairs.poses[train_rows], pairs.wrenches[train_rows]
    test = pairs.poses[test_rows], pairs.wrenches[test_rows]
    table_two = selection.table_two(train, test, settings.degrees, settings.thresholds)
    for row in table_two["degrees"]:
        job.console.print(
            f"  degree {row['degree']}: RMSE fx {row['rmse'][0]:.3g}, fy {row['rmse'][1]:.3g}, "
            f"fz {row['rmse'][2]:.3g} N; kappa {row['kappa']:.4g}"
        )
    b01 = PolynomialModel.fit(*train, settings.degrees[-1], method="pcr", threshold=0.1)
    predicted = b01.predict(test[0])
    job.figures["e_rel_b01"] = selection.relative_error(predicted, test[1])
    energy = selection.energy_learning(
        train,
        test,
        length_m=job.config.mechanism.length_m,
        degrees=settings.energy_degrees,
        counts=[c for c in settings.energy_poses if c <= len(train_rows)],
        seed=job.seed,
    )
    designs = _designs(job, train[0])
    beside = _paper_designs(job, train[0])
    figure_5, errors = selection.design_errors(
        train, test, {name: d.indices for name, d in designs.items()}, degree=settings.degrees[-1]
    )
    for name, values in errors.items():
        job.figures[f"e_rel_design_{name}"] = values
    summary["select"] = {
        "n_train": len(train_rows),
        "n_test": len(test_rows),
        "table_two": table_two,
        "outside": selection.outside(job.figures["e_rel_b01"], predicted, test[1], 0.2),
        "energy": energy,
        "designs": {
            name: {
                "n": len(d.indices),
                "value": d.value,
                "bound": d.bound,
                "efficiency": d.efficiency,
            }
            for name, d in (designs | beside).items()
        },
        "figure_5": figure_5,
    }
    return designs


def _designs(job: Job, poses: F) -> dict[str, Design]:
    designs = {}
    for criterion in DESIGNS:
        designs[criterion] = _design(
            job,
            poses,
            f"design-{criterion}",
            criterion=criterion,
            iterations=_BUDGET[criterion],
            title=f"{criterion} design",
        )
        job.console.print(f"  {criterion}: {designs[criterion].sentence()}")
    return designs


def _paper_designs(job: Job, poses: F) -> dict[str, Design]:
    """The paper's own algorithms, to stand beside: Fedorov's exchange and simple exchange."""
    return {
        f"{criterion} by the paper's exchange": _design(
            job, poses, f"paper-design-{criterion}", criterion=criterion, method="paper"
        )
        for criterion in DESIGNS
    }


def _design(job: Job, poses: F, name: str, *, title: str = "", **search: Any) -> Design:
    """One design of the job, kept as the stage of that name; `title` is that of its bar."""
    settings = job.config.design
    stage = job.stage(name, settings.n, settings.starts, poses)

    def compute() -> Mapping[str, Any]:
        found = optimal_design(
            poses,
            settings.n,
            seed=job.seed,
            threads=job.threads,
            starts=settings.starts,
            progress=job.console.progress(title) if title else None,
            **search,
        )
        return dict(vars(found))

    return Design(**stage.run(compute))


# --- 3 measure and identify --------------------------------------------------


def _measure(
    job: Job,
    pairs: Simulated,
    train: I,
    designs: dict[str, Design],
    summary: dict[str, Any],
) -> dict[str, Table]:
    candidates = pairs.table().select(train)
    clean = _without_hidden(job.config.rig)
    tables = {}
    rows = {}
    for name, design in designs.items():
        plan = paper_plan(candidates, design, seed=job.seed)
        plan.write(job.out / f"plan-{name}.csv")
        tables[name] = measure(job, plan, f"measured-{name}", clean)
        count = len(tables[name].measured())
        rows[name] = {
            "rows": count,
            "skipped": len(design.indices) - count,
            "minutes": float(tables[name].column("time_s").max()) / 60.0,
        }
        job.console.print(
            f"  {name}: {rows[name]['rows']} poses in {rows[name]['minutes']:.0f} robot minutes"
        )
    summary["identify"] = {"campaigns": rows}
    if clean.rig.mode == "robot":
        summary["identify"]["arm"] = _arm(job, clean)
    return tables


def _without_hidden(rig: RigSettings) -> RigSettings:
    return replace(rig, hidden=HiddenTable())


def _arm(job: Job, rig: RigSettings) -> dict[str, Any]:
    """What the arm did in the campaigns of all designs, and Fig. 7."""
    from ecm.rig.arm.run import robot_path
    from ecm.rig.arm.show import pose_on_its_way
    from ecm.rig.arm.summary import digest

    arrays, phases, reason = pose_on_its_way(
        read_table(job.out / f"plan-{DESIGNS[0]}.csv", need="predict"),
        rig,
        seed=job.seed,
        threads=job.threads,
        folder=job.out / "stages" / "anchors",
    )
    job.figures.update({f"arm_{name}": values for name, values in arrays.items()})
    records = {name: digest(robot_path(job.out / f"measured-{name}.csv")) for name in DESIGNS}
    return {"records": records, "phases_s": phases, "not_reached": reason}


def measure(job: Job, plan: Table, name: str, rig: RigSettings) -> Table:
    """A campaign of the job; one that is finished is read again."""
    return campaign_table(
        job.out / f"{name}.csv",
        job.stage(name, hash_of(dict(plan.columns)), rig.to_dict()),
        plan,
        rig,
        seed=job.seed,
        threads=job.threads,
        progress=job.console.progress(name),
    )


def _physics(job: Job, pairs: Simulated) -> PhysicsMap:
    """FEM of the body as a map over these pairs; built once per shape, in the cache folder."""
    bar = job.console.progress("FEM of the body, kept for the next time")
    return physics_map(
        job.config.mechanism,
        threads=job.threads,
        progress=bar,
        reach_rad=reach_of(pairs.table()),
    )


def _identify(
    job: Job, tables: dict[str, Table], physics: PhysicsMap, summary: dict[str, Any]
) -> None:
    settings = job.config.select
    step = summary["identify"]
    rows, figures = validation.table_three(tables, settings.thresholds, degree=settings.degrees[-1])
    step["table_three"] = rows
    for row in rows:
        job.console.print(
            f"  trained on {row['trained_on']}, b = {row['threshold']:g}: RMSE fx "
            f"{row['rmse'][0]:.3g}, fy {row['rmse'][1]:.3g}, fz {row['rmse'][2]:.3g} N; "
            f"kappa {row['kappa']:.4g}"
        )
    for name, arrays in figures.items():
        job.figures[f"e_rel_measured_{name}"] = arrays["e_rel"]
        job.figures[f"observed_{name}"] = arrays["observed"]
        job.figures[f"predicted_{name}"] = arrays["predicted"]

    cubic = fit_model(tables["d"], f"poly:{settings.degrees[-1]}", pcr=0.1)
    poses = np.concatenate([table.measured().poses for table in tables.values()])
    share = validation.symmetric_share(cubic.stiffness(poses))
    rest = np.array([[job.config.mechanism.length_m, 0.0, 0.0, 0.0, 0.0, 0.0]])
    stiffness = cubic.stiffness(rest)[0]
    step["symmetric_share"] = {
        "smallest": float(share.min()),
        "above_0.95": float((share > 0.95).mean()),
    }
    step["stiffness_at_rest"] = stiffness.tolist()
    step["equation_11"] = validation.against_equation_11(stiffness)
    job.figures["symmetric_share"] = share

    step["models"], step["floor"], step["best"], best = _model_table(job, tables, cubic, physics)
    best.save(job.out / "model.json")
    cubic.save(job.out / "model-cubic.json")
    job.console.print(
        "  error over noise on the other design: "
        + ", ".join(f"{row['model']} {row['whitened_rms']:.2f}" for row in step["models"])
        + f"; model.json is {best.name}"
    )


def _model_table(
    job: Job, tables: dict[str, Table], cubic: Model, physics: PhysicsMap
) -> tuple[list[dict[str, Any]], list[float], int, Model]:
    """Models trained on the D-optimal design, on the poses of the other one."""
    train, test = tables["d"].measured(), tables["maximin"].measured()
    few = train.select(np.random.default_rng([job.seed, 6]).permutation(len(train))[:20])
    candidates = [
        (f"degree {job.config.select.degrees[-1]} polynomial, b = 0.1", cubic, len(train)),
        ("energy4", fit_model(few, "energy4"), len(few)),
        ("energy4", fit_model(train, "energy4"), len(train)),
        ("energy6", fit_model(train, "energy6"), len(train)),
        ("physics, E and nu free", fit_model(few, "physics", physics=physics), len(few)),
    ]
    rows: list[dict[str, Any]] = []
    floor: list[float] = []
    for name, model, count in candidates:
        found = compare(model, test)
        floor = [c.floor for c in found.components]
        rows.append(
            {
                "model": name,
                "coefficients": int(np.asarray(model.base.coefficients).size),
                "poses": count,
                "rmse": [c.rmse for c in found.components],
                "whitened_rms": found.whitened_rms,
            }
        )
    # The physics model stands for one body; what a user takes along is fitted to the data.
    fitted = [i for i, (name, _, _) in enumerate(candidates) if not name.startswith("physics")]
    best = min(fitted, key=lambda i: float(rows[i]["whitened_rms"]))
    return rows, floor, best, candidates[best][1]


def _loop(
    job: Job,
    pairs: Simulated,
    train: I,
    physics: PhysicsMap,
    summary: dict[str, Any],
) -> None:
    candidates = pairs.table().select(train)
    # Half as many poses, each visited twice: what the first campaign cost in robot time.
    count = max(20, job.config.design.n // 2)
    chosen = optimal_design(
        candidates.poses,
        count,
        criterion="maximin",
        seed=job.seed,
        threads=job.threads,
        iterations=_BUDGET["maximin"],
    )
    plan = diagnosable_plan(candidates, chosen, seed=job.seed)
    plan.write(job.out / "plan-loop.csv")
    data = measure(job, plan, _LOOP, job.config.rig)
    found = run_loop(
        data,
        physics,
        path=job.out / f"{_LOOP}.csv",
        seed=job.seed,
        threads=job.threads,
        say=job.console.print,
    )
    found.model.save(job.out / "model-loop.json")
    summary["loop"] = found.summary
    job.figures.update(found.figures)


def _times(job: Job, pairs: Simulated, test: I) -> dict[str, Any]:
    """Fig. 11; kept as a stage, since a time is taken once."""
    take = test[:_TIMED_PAIRS]
    stage = job.stage("times", take)
    model = load_model(job.out / "model-cubic.json")

    def compute() -> dict[str, Any]:
        return validation.evaluation_times(
            model.predict, job.config.mechanism, pairs.poses[take], pairs.wrenches[take]
        )

    found = stage.run(compute)
    job.console.print(
        f"  one evaluation: FEM {1e3 * float(np.median(found['fem_s'])):.0f} ms, model "
        f"{1e6 * float(np.median(found['model_s'])):.0f} us from Python; "
        f"{found['ratio_of_medians']:.0f} times faster"
    )
    return found


def _report(job: Job, summary: dict[str, Any], times: dict[str, Any]) -> None:
    from ecm.report.page import write_page
    from ecm.workflow.report_identify import identify_sections

    path = job.out / "report.html"
    lead = (
        f"{_described(job.config)}; {summary['simulate']['counts']['kept']} simulated wrench-pose "
        f"pairs, designs of {job.config.design.n} poses, seed {job.seed}."
    )
    sections = identify_sections(summary, job.figures, times)
    try:
        write_page(path, "Stiffness identification", lead, sections)
    except MissingExtra as error:
        job.console.print(f"{job.out / 'summary.json'}: the numbers; no report.html: {error}")
        return
    job.console.print(f"{path}: the report; {job.out / 'summary.json'}: its numbers")


def _described(config: Config) -> str:
    body = config.mechanism
    name = body.builtin or (body.mesh_file.name if body.mesh_file is not None else "mechanism")
    return (
        f"A {name} of length {1e3 * body.length_m:.1f} mm, E = "
        f"{1e-6 * body.young_modulus_Pa:.3g} MPa, ν = {body.poisson_ratio:g}"
    )
