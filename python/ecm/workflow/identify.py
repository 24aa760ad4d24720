"""The main job: simulate, select, measure, identify; then find and add the missing effect.

Each step is a stage: its result is kept under a hash of its settings and inputs, so an
interrupted run goes on where it was. Numbers go to `summary.json`, times to `times.json`: the
same seed gives the same bytes in the summary on any number of threads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ecm import _native
from ecm.comparison import Comparison, compare
from ecm.designs import (
    Design,
    DesignSettings,
    diagnosable_plan,
    nominal_model,
    offsets_from_free,
    optimal_design,
    paper_plan,
)
from ecm.diagnosis import diagnose
from ecm.errors import MissingExtra
from ecm.fem.simulate import Simulated, simulate
from ecm.io.arguments import check_arguments, path_of
from ecm.io.arrays import F, I
from ecm.io.cache import write_json
from ecm.io.columns import POSE
from ecm.io.table import Table, read_table
from ecm.models import (
    Model,
    PhysicsMap,
    PhysicsModel,
    PolynomialModel,
    fit_model,
    load_model,
    physics_map,
)
from ecm.models.actuated import ActuatedMap
from ecm.models.physics.map import poses_meant
from ecm.models.prediction import symmetric_share
from ecm.regression.blas import one_blas_thread
from ecm.report.blocks import Report, require_report
from ecm.rig import HiddenTable, RigSettings, fem_source, reveal
from ecm.rig.arm.campaign import RobotCampaign, first_pose_trace, require_arm
from ecm.rig.arm.trips import read_summary
from ecm.rig.plan import rest_pose
from ecm.rig.readings import robot_path
from ecm.workflow import paper as steps
from ecm.workflow.config import Config, Console, Job, Silent, read_config
from ecm.workflow.report_identify import (
    arm_section,
    design_section,
    loop_section,
    measurement_section,
    result_section,
    selection_section,
    simulation_section,
    speed_section,
    stiffness_section,
    workspace_blocks,
)

DESIGNS = ("d", "maximin")
_RIGS = {"quasi_static": "the simulated rig", "robot": "the simulated rig with its arm"}
_LOOP = "measured-loop"
_TIMED_PAIRS = 100
_ITERATIONS = {"d": 300, "maximin": 50}  # a second; within 0.01 % of what the default reaches here


@one_blas_thread()
def identify(
    config: Config | str | Path,
    out: str | Path,
    *,
    seed: int = 0,
    threads: int = 0,
    console: Console | None = None,
) -> dict[str, Any]:
    """Carry out the paper's three steps, then find the effect that the model lacks.

    Parameters
    ----------
    config
        Settings, or the TOML file that holds them.
    out
        Folder of the results: `summary.json`, `times.json`, `model.json`, the tables as CSV, and
        `report.html` with the extra `report`. A run that was interrupted goes on there.
    seed
        Seed of the random generator.
    threads
        0: all cores. The results do not depend on it.
    console
        Where lines and progress are printed; default nowhere.

    Returns
    -------
    dict
        The content of `summary.json`.

    Raises
    ------
    InputError
        Settings that do not fit each other, or tables in `out` that the job has not measured.

    Examples
    --------
    >>> from ecm.workflow.config import Config, SimulateTable
    >>> identify(Config(simulate=SimulateTable(n=60, n_test=10)), "unused")
    Traceback (most recent call last):
    ...
    ecm.errors.InputError: [design] n = 200: expected at most the 50 training pairs of [simulate] \
(n - n_test)
    """
    check_arguments(identify, locals())
    if not isinstance(config, Config):
        config = read_config(config)
    job = Job(config, path_of(out), seed, threads, console or Silent())
    _check(job)
    job.summary |= {
        "format": "ecm-identify",
        "version": 1,
        "program": _native.__version__,
        "seed": seed,
        "mechanism": config.mechanism.to_dict(),
        "of_paper": job.of_paper,
    }
    with job.step("simulate", "1 Simulate: FEM poses of random wrenches"):
        pairs = simulate_pairs(job)
        train, test = steps.split(len(pairs), config.simulate.n_test, seed)
    with job.step("select", "2 Select: a model, and the poses worth measuring"):
        designs = select(job, _rows(pairs, train), _rows(pairs, test))
    with job.step("measure", f"3 Measure and identify: {_RIGS[config.rig.rig.mode]}"):
        candidates = pairs.table().select(train)
        tables = measure_designs(job, candidates, designs)
        physics = None if _driven(job) else build_physics(job, pairs)
        identify_models(job, tables, physics)
    with job.step("loop", "4 The loop: what is hidden in the rig is looked for, and added"):
        find_hidden_effect(job, candidates, physics)
    with job.step("time", "Evaluation time against FEM"):
        evaluation = measure_times(job, pairs, test[:_TIMED_PAIRS])
    times = {"stages_s": job.stages_s, "evaluation": evaluation}
    write_json(job.out / "summary.json", job.summary)
    write_json(job.out / "times.json", times)
    _write_report(job, times)
    return job.summary


def _check(job: Job) -> None:
    """Raise before any work where a later step could not be done."""
    config = job.config
    config.check_job()
    if config.rig.rig.mode == "robot":
        require_arm(job.stages / "anchors")
    for name in (*(f"measured-{name}" for name in DESIGNS), _LOOP):
        job.require_possible(name, config.rig)
    job.out.mkdir(parents=True, exist_ok=True)
    try:
        require_report()
    except MissingExtra as error:
        job.console.print(f"There will be no report.html: {error}")


def _rows(pairs: Simulated, rows: I) -> tuple[F, F]:
    """Poses, with the actuators' inputs after them where there are some, and wrenches."""
    return np.hstack([pairs.poses, pairs.actuation])[rows], pairs.wrenches[rows]


def _driven(job: Job) -> tuple[str, ...]:
    """Columns of the mechanism's actuators."""
    return job.config.mechanism.actuators


def _from_free(job: Job, plan: Table, candidates: Table) -> Table:
    """The plan of a driven mechanism as offsets from its free poses."""
    if not _driven(job):
        return plan
    base = nominal_model(candidates).base
    return offsets_from_free(plan, base) if isinstance(base, ActuatedMap) else plan


# --- 1 simulate --------------------------------------------------------------


def simulate_pairs(job: Job) -> Simulated:
    """Step 1: wrench-pose pairs by FEM; writes `simulated.csv`."""
    config = job.config
    pairs = simulate(
        config.mechanism,
        config.simulate.n,
        config.workspace,
        seed=job.seed,
        threads=job.threads,
        directory=job.stages,
        progress=job.console.progress(f"FEM pairs{config.mechanism.size_words}"),
    )
    for text in pairs.warnings:
        job.console.print(f"warning: {text}")
    counts = pairs.counts
    rest = config.mechanism.fem().rest_stiffness()
    equation_11 = steps.against_equation_11(rest, job.of_paper)
    job.summary["simulate"] = {
        "counts": counts,
        "iterations_mean": float(pairs.iterations.mean()),
        "largest_rotation_rad": float(np.linalg.norm(pairs.poses[:, 3:], axis=1).max()),
        "largest_stretch": float(pairs.largest_stretch.max()),
        "stiffness_at_rest": rest.tolist(),
        "equation_11": equation_11,
    }
    job.figures["simulated_poses"] = pairs.poses
    job.show(simulation_section(job.summary["simulate"], job.figures, job.of_paper))
    pairs.table().write(job.out / "simulated.csv")
    return pairs


# --- 2 select ----------------------------------------------------------------


def select(job: Job, train: tuple[F, F], test: tuple[F, F]) -> dict[str, Design]:
    """Step 2: compare models on the test pairs, and choose the poses worth measuring."""
    settings = job.config.select
    paper = job.of_paper
    table_two = steps.table_two(train, test, settings.degrees, settings.thresholds, paper)
    b01 = _native.PolynomialEvaluator.fit(*train, settings.degrees[-1], method="pcr", threshold=0.1)
    predicted = b01.predict(test[0])
    job.figures["e_rel_b01"] = steps.relative_error(predicted, test[1])
    energy = steps.energy_learning(
        train,
        test,
        length_m=job.config.mechanism.length_m,
        actuators=_driven(job),
        degrees=settings.energy_degrees,
        counts=[count for count in settings.energy_poses if count <= len(train[0])],
        seed=job.seed,
    )
    designs = {
        name: _design(job, train[0], f"design-{name}", criterion=name, iterations=most)
        for name, most in _ITERATIONS.items()
    }
    by_paper = {  # the paper's own algorithms: Fedorov's exchange and simple exchange
        f"{name} by the paper's exchange": _design(
            job, train[0], f"paper-design-{name}", criterion=name, method="paper"
        )
        for name in DESIGNS
    }
    figure_5, errors = steps.design_errors(
        train, test, {name: d.indices for name, d in designs.items()}, degree=settings.degrees[-1]
    )
    job.figures |= {f"e_rel_design_{name}": values for name, values in errors.items()}
    job.summary["select"] = {
        "n_train": len(train[0]),
        "n_test": len(test[0]),
        "table_two": table_two,
        "outside": steps.outside(job.figures["e_rel_b01"], predicted, test[1], 0.2),
        "energy": energy,
        "designs": {
            name: {"n": len(design.indices)}
            | {key: getattr(design, key) for key in ("value", "bound", "efficiency")}
            for name, design in (designs | by_paper).items()
        },
        "figure_5": figure_5,
    }
    job.show(selection_section(job.summary["select"], job.figures, paper))
    job.show(design_section(job.summary["select"], job.figures, paper))
    return designs


def _design(job: Job, poses: F, name: str, **search: Any) -> Design:
    """Return a design for the job's highest degree; it is kept as the stage of that name."""
    settings, driven = job.config.design, _driven(job)
    model = f"poly:{job.config.select.degrees[-1]}"
    if driven:
        model = f"actuated{job.config.select.energy_degrees[-1]}"

    def compute() -> Mapping[str, Any]:
        search_settings = DesignSettings(
            model=model,
            length_m=job.config.mechanism.length_m,
            columns=(*POSE, *driven),
            starts=settings.starts,
            seed=job.seed,
            threads=job.threads,
            **search,
        )
        progress = job.console.progress(name)
        return dict(vars(optimal_design(poses, settings.n, search_settings, progress=progress)))

    return Design(**job.stage(name, model, settings.n, settings.starts, poses).run(compute))


# --- 3 measure and identify --------------------------------------------------


def measure_designs(job: Job, candidates: Table, designs: dict[str, Design]) -> dict[str, Table]:
    """Step 3: a campaign on each design, with nothing hidden in the rig."""
    rig = replace(job.config.rig, hidden=HiddenTable())
    tables, rows = {}, {}
    for name, design in designs.items():
        plan = _from_free(job, paper_plan(candidates, design, seed=job.seed), candidates)
        plan.write(job.out / f"plan-{name}.csv")
        tables[name] = job.measure(plan, f"measured-{name}", rig)
        count = len(tables[name].measured())
        minutes = float(tables[name].column("time_s").max()) / 60.0
        skipped = len(design.indices) - count
        rows[name] = {"rows": count, "skipped": skipped, "minutes": minutes}
    job.summary["identify"] = {"campaigns": rows}
    if rig.rig.mode == "robot":
        job.summary["identify"]["arm"] = arm = _arm(job, rig)
        job.sections.append(arm_section(arm, job.figures))
    return tables


def _arm(job: Job, rig: RigSettings) -> dict[str, Any]:
    """What the arm did in the campaigns of all designs, and Fig. 7."""
    plan = read_table(job.out / f"plan-{DESIGNS[0]}.csv", need="predict")
    source = fem_source(plan, job.threads)
    campaign = RobotCampaign(plan, rig, source, seed=job.seed, folder=job.stages / "anchors")
    arrays, phases, reason = first_pose_trace(campaign)
    job.figures |= {f"arm_{name}": values for name, values in arrays.items()}
    records = {name: read_summary(robot_path(job.out / f"measured-{name}.csv")) for name in DESIGNS}
    return {"records": records, "phases_s": phases, "not_reached": reason}


def build_physics(job: Job, pairs: Simulated) -> PhysicsMap:
    """FEM of the body as a map over the poses of these pairs; kept in the cache folder."""
    body = job.config.mechanism
    return physics_map(
        body,
        threads=job.threads,
        progress=job.console.progress(f"FEM of the body, kept for the next time{body.size_words}"),
        poses=poses_meant(pairs.table()),
    )


def identify_models(job: Job, tables: dict[str, Table], physics: PhysicsMap | None) -> None:
    """Models of the measurements; writes `model.json` and `model-cubic.json`."""
    settings, step = job.config.select, job.summary["identify"]
    degree, paper = settings.degrees[-1], job.of_paper
    rows, figures = steps.table_three(tables, settings.thresholds, degree=degree, paper=paper)
    job.figures |= figures
    cubic = fit_model(tables["d"], PolynomialModel(degree, pcr=0.1))
    cubic.save(job.out / "model-cubic.json")
    models, floor, best, result = _model_table(job, tables, cubic, physics)
    model, maps = result.compared.model, result.where()
    model.save(job.out / "model.json")
    # The paper's stiffness is that of its polynomial; one of pose and inputs is far off.
    inputs = _driven(job)
    shown = model if inputs else cubic
    poses = np.concatenate([table.measured().matrix((*POSE, *inputs)) for table in tables.values()])
    share = symmetric_share(shown.stiffness(poses)[:, :, :6])
    job.figures["symmetric_share"] = share
    rest = rest_pose(job.config.mechanism.length_m, len(inputs))[None]
    stiffness = shown.stiffness(rest)[0, :, :6]
    job.figures["workspace_poses"] = result.compared.table.poses[maps.row - 1]
    job.figures["workspace_residual"] = maps.size
    step |= {
        "degree": degree,
        "table_three": rows,
        "symmetric_share": {
            "smallest": float(share.min()),
            "above_0.95": float((share > 0.95).mean()),
        },
        "stiffness_of": model.name if inputs else f"the polynomial of degree {degree}",
        "stiffness_at_rest": stiffness.tolist(),
        "equation_11": steps.against_equation_11(stiffness, paper),
        "models": models,
        "floor": floor,
        "best": best,
    }
    job.show(measurement_section(step, job.figures, paper))
    job.show(stiffness_section(step, job.figures, paper))
    job.show(result_section(step, {}, ()))


def _model_table(
    job: Job, tables: dict[str, Table], cubic: Model, physics: PhysicsMap | None
) -> tuple[list[dict[str, Any]], list[float], int, Comparison]:
    """Models trained on the D-optimal design, on the poses of the other one."""
    train, test = tables["d"].measured(), tables["maximin"].measured()
    few = train.select(np.random.default_rng([job.seed, 6]).permutation(len(train))[:20])
    low, high = ("energy4", "energy6")
    if _driven(job):
        degrees = job.config.select.energy_degrees
        low, high = (f"actuated{degree}" for degree in (degrees[0], degrees[-1]))
    candidates = [
        (f"degree {job.config.select.degrees[-1]} polynomial, b = 0.1", cubic, len(train)),
        (low, fit_model(few, low), len(few)),
        (low, fit_model(train, low), len(train)),
        (high, fit_model(train, high), len(train)),
    ]
    if physics is not None:
        own = fit_model(few, PhysicsModel(base=physics))
        candidates.append(("physics, E and nu free", own, len(few)))
    compared = [compare(model, test) for _, model, _ in candidates]
    rows = [
        {
            "model": name,
            "coefficients": int(np.asarray(model.base.coefficients).size),
            "poses": count,
            "rmse": [component.rmse for component in result.components],
            "whitened_rms": result.whitened_rms,
        }
        for (name, model, count), result in zip(candidates, compared, strict=True)
    ]
    # The physics model stands for one body; what a user takes along is fitted to the data.
    fitted = [i for i, (name, _, _) in enumerate(candidates) if not name.startswith("physics")]
    best = min(fitted, key=lambda i: compared[i].whitened_rms)
    return rows, [c.floor for c in compared[-1].components], best, compared[best]


# --- 4 the loop --------------------------------------------------------------


def find_hidden_effect(job: Job, candidates: Table, physics: PhysicsMap | None) -> None:
    """Step 4: measure with the hidden effect, diagnose, refit; writes `model-loop.json`."""
    # Half as many poses, each visited twice: what the first campaign cost in robot time.
    settings = DesignSettings(
        criterion="maximin", seed=job.seed, threads=job.threads, iterations=_ITERATIONS["maximin"]
    )
    rows = candidates.matrix((*POSE, *_driven(job)))
    design = optimal_design(rows, max(20, job.config.design.n // 2), settings)
    plan = _from_free(job, diagnosable_plan(candidates, design, seed=job.seed), candidates)
    plan.write(job.out / "plan-loop.csv")
    data = job.measure(plan, _LOOP, job.config.rig)
    run_loop(job, data, physics).save(job.out / "model-loop.json")


def run_loop(job: Job, data: Table, physics: PhysicsMap | None) -> Model:
    """Fit the physics base, find what it lacks, add it, refit; then open the sealed truth.

    Of a driven mechanism the base is an energy of pose and actuation.

    Parameters
    ----------
    job
        Takes the numbers of the summary and the arrays of the figures.
    data
        The measured table, as read from a file: its truth, where one was sealed, is beside it.
    physics
        Map of the body; None of a driven mechanism.

    Returns
    -------
    Model
        The model with what it lacked.
    """
    seed = job.seed
    if physics is None:
        model = fit_model(data, f"actuated{job.config.select.energy_degrees[-1]}")
    else:
        model = fit_model(data, PhysicsModel(base=physics, threads=job.threads))
    before = compare(model, data, seed=seed)
    diagnosis = diagnose(model, data, seed=seed).to_dict()
    answer = diagnosis["answer"]
    # All members of a class predict alike; the first is the likeliest.
    ids = [members[0] for members in answer]
    ids += [effect["id"] for effect in diagnosis["effects"] if effect["id"] not in ids]
    better = model
    for effect in ids:
        better = better.add(effect).fit(data)
    after = compare(better, data, noise=before.noise, seed=seed)
    history = [record.to_dict() for record in better.history]
    score = reveal(data, diagnosis).score if data.meta.file.truth_sha256 else None
    job.figures |= {"loop_before": before.whitened, "loop_after": after.whitened}
    measured = data.measured()
    if measured.has("time_s"):
        job.figures["loop_time_s"] = measured.column("time_s")
    job.summary["loop"] = {
        "rows": before.rows,
        "minutes": float(data.column("time_s").max()) / 60.0 if data.has("time_s") else None,
        "before": before.to_dict(),
        "after": after.to_dict(),
        "diagnosis": diagnosis,
        "history": history,
        "score": score,
    }
    job.show(loop_section(job.summary["loop"], job.figures))
    return better


def measure_times(job: Job, pairs: Simulated, rows: I) -> dict[str, Any]:
    """Fig. 11: the model against the FEM; kept as a stage, since a time is taken once."""
    own = "model" if _driven(job) else "model-cubic"  # the paper's is its polynomial
    model = load_model(job.out / f"{own}.json")
    times = job.stage(f"times-of-{own}", rows).run(
        lambda: steps.evaluation_times(
            model, job.config.mechanism, _rows(pairs, rows)[0], pairs.loads[rows]
        )
    )
    job.show(speed_section(times, job.of_paper))
    return times


def _write_report(job: Job, times: dict[str, Any]) -> None:
    path, numbers = job.out / "report.html", job.out / "summary.json"
    body = job.config.mechanism
    name = body.builtin or (body.mesh_file.name if body.mesh_file is not None else "mechanism")
    lead = (
        f"Body: {name}, {1e3 * body.length_m:.1f} mm long, E = "
        f"{1e-6 * body.young_modulus_Pa:.3g} MPa, ν = {body.poisson_ratio:g}; "
        f"{job.summary['simulate']['counts']['kept']} simulated wrench-pose pairs, designs of "
        f"{job.config.design.n} poses, seed {job.seed}."
    )
    try:
        # The result comes first, now with the pictures, and the loop last.
        *steps_of_work, _, loop, speed = job.sections
        pictures = workspace_blocks(job.figures, body)
        result = result_section(job.summary["identify"], times["stages_s"], pictures)
        sections = [result, *steps_of_work, speed, loop]
        Report("Stiffness identification", lead, sections).write(path)
    except MissingExtra as error:
        job.console.print(f"{numbers}: the numbers; no report.html: {error}")
        return
    job.console.print(f"{path}: the report; {numbers}: its numbers")
