//! The binary as its users see it: files, exit codes, messages.

#![allow(clippy::unwrap_used)]

mod common;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const HEADER: &str = "x_m,y_m,z_m,theta_x_rad,theta_y_rad,theta_z_rad,note\n";

fn folder(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

fn candidates(folder: &Path, count: usize) -> PathBuf {
    let mut text = HEADER.to_owned();
    for (i, p) in common::uniform(4, count, 6).chunks_exact(6).enumerate() {
        let (x, y, z) = (0.1 + 0.01 * p[0], 0.02 * p[1], 0.02 * p[2]);
        writeln!(
            text,
            "{x:.9},{y:.9},{z:.9},{:.9},{:.9},{:.9},\"pose, {i}\"",
            p[3], p[4], p[5]
        )
        .unwrap();
    }
    let path = folder.join("c.csv");
    std::fs::write(&path, text).unwrap();
    path
}

fn design(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ecm-design"))
        .args(arguments)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[test]
fn rows_are_copied_unchanged() {
    let dir = folder("copied");
    let path = candidates(&dir, 300);
    let input = std::fs::read_to_string(&path).unwrap();
    let lines: std::collections::HashSet<&str> = input.lines().skip(1).collect();
    let json = dir.join("s.json");
    let out = dir.join("plan.csv");
    let arguments = [
        path.to_str().unwrap(),
        "--n",
        "100",
        "--iterations",
        "20",
        "--out",
        out.to_str().unwrap(),
        "--json",
        json.to_str().unwrap(),
    ];
    let result = design(&arguments);
    assert_eq!(result.status.code(), Some(0), "{}", text(&result.stderr));
    assert!(text(&result.stderr).contains("% of what is possible"));
    let plan = std::fs::read_to_string(&out).unwrap();
    let mut chosen = std::collections::HashSet::new();
    assert!(plan.starts_with(&format!(
        "{},pose_id,kind,approach,dwell_s,run,action\n",
        HEADER.trim()
    )));
    for line in plan.lines().skip(1) {
        let own = line.strip_suffix(",pose,initial,,0,measure").unwrap();
        let (own, _) = own.rsplit_once(',').unwrap();
        assert!(lines.contains(own), "{own}");
        assert!(chosen.insert(own.to_owned()), "twice: {own}");
    }
    assert_eq!(chosen.len(), 100);
    let summary: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
    assert_eq!(summary["rows"].as_array().unwrap().len(), 100);
    assert!(summary["efficiency"].as_f64().unwrap() > 0.9);
    let again = design(&arguments);
    assert_eq!(again.status.code(), Some(0));
    assert_eq!(plan, std::fs::read_to_string(&out).unwrap());
}

#[test]
fn other_columns_and_lists() {
    let dir = folder("lists");
    let path = dir.join("t.csv");
    let mut table = "name,a,b\n".to_owned();
    for i in 0..50 {
        writeln!(table, "p{i},{},{}", i % 10, i / 10).unwrap();
    }
    std::fs::write(&path, table).unwrap();
    let p = path.to_str().unwrap();
    for criterion in ["d", "i", "a", "g", "di", "maximin"] {
        let result = design(&[
            p,
            "--n",
            "8",
            "--criterion",
            criterion,
            "--model",
            "quadratic",
            "--iterations",
            "5",
            "--include",
            "13,24",
            "--exclude",
            "a>7&b<=1",
            "--exclude",
            "1-2",
            "--quiet",
        ]);
        assert_eq!(result.status.code(), Some(0), "{}", text(&result.stderr));
        assert!(result.stderr.is_empty());
        let plan = text(&result.stdout);
        let rows: Vec<&str> = plan.lines().collect();
        assert_eq!((rows[0], rows.len()), ("name,a,b", 11));
        assert!(rows.contains(&"p12,2,1") && rows.contains(&"p23,3,2"));
        for out in ["p0,", "p1,", "p8,", "p9,", "p18,", "p19,"] {
            assert!(!rows.iter().any(|r| r.starts_with(out)), "{out}");
        }
    }
}

/// A mark of the byte order, quoted cells, empty lines, and line ends of Windows.
#[test]
fn cells_are_copied_as_their_text() {
    let path = folder("cells").join("t.csv");
    let table = b"\xef\xbb\xbfname,a\r\n\"p, \"\"1\"\"\",1.50e-1\r\n\r\nq,2\nr, 3 \n";
    std::fs::write(&path, table).unwrap();
    let p = path.to_str().unwrap();
    let base = [p, "--n", "3", "--model", "linear", "--iterations", "1"];
    let result = design(&base);
    assert_eq!(
        text(&result.stdout),
        "name,a\n\"p, \"\"1\"\"\",1.50e-1\nq,2\nr, 3 \n",
        "{}",
        text(&result.stderr)
    );
    for list in ["0", "4", "3-2", "a", "", "1,,2", "-3", "1,1"] {
        let refused = design(&[&base[..], &[&format!("--include={list}")]].concat());
        assert_eq!(refused.status.code(), Some(2), "{list}");
        let said = text(&refused.stderr);
        let wanted = ["--include: ", "from 1 to 3", "occurs twice"];
        assert!(said.contains(wanted[0]) && wanted[1..].iter().any(|w| said.contains(w)));
    }
}

/// What was measured at the candidates is no part of a plan; other columns are.
#[test]
fn measured_wrenches_stay_behind() {
    let dir = folder("wrench");
    let path = dir.join("t.csv");
    let mut table = "fx_N,x_m,sd_fx_N,theta_x_rad,leds,run,time_s\n".to_owned();
    for i in 0..30 {
        writeln!(table, "1.5,0.0{},0.1,0.{},{i},7,9", i % 6, i / 6).unwrap();
    }
    std::fs::write(&path, table).unwrap();
    let p = path.to_str().unwrap();
    let base = [p, "--n", "6", "--criterion", "maximin", "--iterations", "5"];
    let plain = design(&base);
    assert_eq!(plain.status.code(), Some(0), "{}", text(&plain.stderr));
    assert!(
        text(&plain.stdout)
            .starts_with("x_m,theta_x_rad,leds,pose_id,kind,approach,dwell_s,run,action\n")
    );
    assert!(text(&plain.stderr).contains("coordinates scaled to [-1, 1]"));
    let orders: std::collections::HashSet<String> = (0..4)
        .map(|seed| {
            let seed = seed.to_string();
            text(&design(&[&base[..], &["--seed", &seed]].concat()).stdout)
        })
        .collect();
    assert!(orders.len() > 1, "the visiting order follows the seed");
    // A radian of 1 mm: only x_m counts, of which there are six values.
    let metres = design(&[&base[..], &["--metres-per-radian", "0.001"]].concat());
    assert!(text(&metres.stderr).contains("a radian counts as 0.001 m"));
    let xs: std::collections::HashSet<String> = text(&metres.stdout)
        .lines()
        .skip(1)
        .map(|line| line.split(',').next().unwrap().to_owned())
        .collect();
    assert_eq!(xs.len(), 6);
    let wrong = design(&[&base[..], &["--metres-per-radian", "-1"]].concat());
    assert_eq!(wrong.status.code(), Some(2));
    let other = [
        &base[..],
        &["--columns", "leds", "--metres-per-radian", "1"],
    ]
    .concat();
    assert!(text(&design(&other).stderr).contains("leds is no pose column"));
}

#[test]
fn energy_models_take_the_length_beside_the_table() {
    let dir = folder("energy");
    let path = candidates(&dir, 120);
    let p = path.to_str().unwrap();
    let arguments = [p, "--n", "10", "--model", "energy4", "--iterations", "5"];
    let result = design(&arguments);
    assert_eq!(result.status.code(), Some(2));
    assert!(text(&result.stderr).contains("length_m"));
    std::fs::write(dir.join("c.toml"), "[mechanism]\nlength_m = 0.1\n").unwrap();
    let result = design(&arguments);
    assert_eq!(result.status.code(), Some(0), "{}", text(&result.stderr));
    assert_eq!(text(&result.stdout).lines().count(), 11);
}

#[test]
fn measured_poses_are_taken_into_account() {
    let dir = folder("augment");
    let path = candidates(&dir, 200);
    let whole = std::fs::read_to_string(&path).unwrap();
    let first: Vec<&str> = whole.lines().take(91).collect();
    let done = dir.join("done.csv");
    std::fs::write(&done, first.join("\n")).unwrap();
    let p = path.to_str().unwrap();
    let few = [p, "--n", "20", "--iterations", "5"];
    assert_eq!(design(&few).status.code(), Some(2));
    let mut more = few.to_vec();
    more.extend(["--augment", done.to_str().unwrap()]);
    let result = design(&more);
    assert_eq!(result.status.code(), Some(0), "{}", text(&result.stderr));
    assert_eq!(text(&result.stdout).lines().count(), 21);
}

#[test]
fn broken_input_exits_with_2_and_says_where() {
    let dir = folder("broken");
    let good = "1,2\n3,5\n4,4\n5,1\n6,7\n8,3\n9,9\n";
    let cases: &[(&str, &str, &[&str], &[&str])] = &[
        ("empty file", "", &[], &["empty", "header"]),
        ("no rows", "a,b\n", &[], &["no data row"]),
        (
            "text",
            "a,b\n1,2\n3,x\n",
            &[],
            &["row 2 (line 3)", "column b", "\"x\"", "--skip-bad-rows"],
        ),
        (
            "nan",
            "a,b\n1,2\nNaN,4\n",
            &[],
            &["row 2", "column a", "NaN", "finite"],
        ),
        (
            "infinite",
            "a,b\n1,inf\n3,4\n",
            &[],
            &["row 1", "column b", "inf"],
        ),
        (
            "ragged",
            "a,b\n1,2\n3\n",
            &[],
            &["row 2 (line 3)", "1 cells", "expected 2"],
        ),
        ("twice", "a,a\n1,2\n", &[], &["\"a\"", "twice"]),
        ("semicolons", "a;b\n1;2\n", &[], &["separated", "','"]),
        (
            "no numbers",
            "a,b\nx,y\n",
            &[],
            &["no column holds numbers"],
        ),
        ("unit", "x_mm,y_mm\n1,2\n", &[], &["\"x_mm\"", "\"x_m\""]),
        ("no unit", "theta_x,b\n1,2\n", &[], &["theta_x_rad"]),
        ("a force's unit", "a,fx_kN\n1,2\n", &[], &["\"fx_N\""]),
        ("a torque's unit", "a,tau_z\n1,2\n", &[], &["tau_z_Nm"]),
        (
            "millimetres",
            "x_m,y_m\n0.1,2\n103.4,4\n",
            &[],
            &["row 2", "x_m", "millimetres"],
        ),
        (
            "degrees",
            "x_m,theta_x_rad\n0.1,30\n",
            &[],
            &["theta_x_rad", "degrees"],
        ),
        (
            "constant",
            "a,b\n1,2\n1,3\n1,4\n1,5\n",
            &[],
            &["column a", "every row"],
        ),
        (
            "n above rows",
            &format!("a,b\n{good}"),
            &["--n", "8", "--model", "linear"],
            &["n = 8", "7"],
        ),
        (
            "n below terms",
            &format!("a,b\n{good}"),
            &["--n", "4", "--model", "quadratic"],
            &["n = 4", "6 coefficients"],
        ),
        (
            "duplicates",
            &format!("a,b\n{}", "1,2\n3,4\n5,5\n".repeat(3)),
            &["--n", "4", "--model", "linear"],
            &["only 3 of 9", "6 repeat"],
        ),
        (
            "model",
            &format!("a,b\n{good}"),
            &["--model", "spline"],
            &["spline", "poly:D"],
        ),
        (
            "energy without pose",
            &format!("a,b\n{good}"),
            &["--model", "energy4"],
            &["six pose columns"],
        ),
        (
            "unknown column",
            &format!("a,b\n{good}"),
            &["--columns", "a,c"],
            &["\"c\"", "a, b"],
        ),
        (
            "row list",
            &format!("a,b\n{good}"),
            &["--include", "9"],
            &["--include", "from 1 to 7"],
        ),
        (
            "region",
            &format!("a,b\n{good}"),
            &["--exclude", "c<3"],
            &["--exclude", "a, b"],
        ),
        (
            "contradiction",
            &format!("a,b\n{good}"),
            &["--include", "2", "--exclude", "1-3"],
            &["row 2", "both"],
        ),
        (
            "rank",
            "a,b\n1,2\n2,4\n3,6\n4,8\n",
            &["--model", "linear"],
            &["combination"],
        ),
        (
            "missing augment",
            &format!("a,b\n{good}"),
            &["--augment", "nowhere.csv"],
            &["nowhere.csv", "cannot be read"],
        ),
        (
            "starts",
            &format!("a,b\n{good}"),
            &["--starts", "0", "--model", "linear"],
            &["starts", "at least 1"],
        ),
        (
            "ridge",
            &format!("a,b\n{good}"),
            &["--ridge=-1", "--model", "linear"],
            &["--ridge", "positive"],
        ),
        (
            "time",
            &format!("a,b\n{good}"),
            &["--time-limit=-1"],
            &["--time-limit"],
        ),
        (
            "flag",
            &format!("a,b\n{good}"),
            &["--criterion", "z"],
            &["maximin"],
        ),
    ];
    for (name, table, extra, words) in cases {
        let path = dir.join("t.csv");
        std::fs::write(&path, table).unwrap();
        let mut arguments = vec![path.to_str().unwrap()];
        if !extra.contains(&"--n") {
            arguments.extend(["--n", "3"]);
        }
        arguments.extend(*extra);
        let result = design(&arguments);
        let message = text(&result.stderr);
        assert_eq!(result.status.code(), Some(2), "{name}: {message}");
        for word in *words {
            assert!(message.contains(word), "{name}: no {word:?} in {message}");
        }
        assert!(!message.contains("panicked"), "{name}");
    }
    let nowhere = design(&["nowhere.csv", "--n", "3"]);
    assert_eq!(nowhere.status.code(), Some(2));
    let path = candidates(&dir, 120);
    let disk = design(&[
        path.to_str().unwrap(),
        "--n",
        "90",
        "--iterations",
        "1",
        "--out",
        "/nowhere/plan.csv",
    ]);
    assert_eq!(disk.status.code(), Some(1), "{}", text(&disk.stderr));
}

#[test]
fn bad_rows_can_be_left_out() {
    let path = folder("skip").join("t.csv");
    std::fs::write(&path, "a,b\n1,2\n3,x\n4,4\n5,1\n").unwrap();
    let p = path.to_str().unwrap();
    let result = design(&[
        p,
        "--n",
        "3",
        "--model",
        "linear",
        "--skip-bad-rows",
        "--iterations",
        "1",
    ]);
    assert_eq!(result.status.code(), Some(0));
    assert_eq!(text(&result.stdout), "a,b\n1,2\n4,4\n5,1\n");
    assert!(text(&result.stderr).contains("1 rows with bad cells"));
}

/// A million rows: read, thinned for the distances, and some of them written.
#[test]
fn a_million_rows() {
    let dir = folder("million");
    let path = dir.join("t.csv");
    let mut table = "a,b\n".to_owned();
    let mut state = 1u64;
    for _ in 0..1_000_000 {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        writeln!(table, "0.{},0.{}", state >> 44, (state >> 20) & 0xfffff).unwrap();
    }
    std::fs::write(&path, table).unwrap();
    let base = [
        path.to_str().unwrap(),
        "--n",
        "8",
        "--iterations",
        "2",
        "--starts",
        "1",
    ];
    for more in [["--model", "linear"], ["--criterion", "maximin"]] {
        let result = design(&[&base[..], &more].concat());
        assert_eq!(result.status.code(), Some(0), "{}", text(&result.stderr));
        assert_eq!(text(&result.stdout).lines().count(), 9);
        assert!(text(&result.stderr).contains("of 1000000 candidates"));
    }
}

/// Bytes of a table changed, cut or doubled at random: a plan or a message, never a panic.
#[test]
fn damaged_tables_end_with_a_plan_or_a_message() {
    use rand::{RngExt, SeedableRng};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
    let dir = folder("damaged");
    let whole = std::fs::read(candidates(&dir, 30)).unwrap();
    let path = dir.join("d.csv");
    let mut codes = std::collections::BTreeMap::new();
    for case in 0..120 {
        let mut bytes = whole.clone();
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..bytes.len());
            let end = (at + rng.random_range(1..60)).min(bytes.len());
            match rng.random_range(0..5) {
                0 => bytes[at] = rng.random_range(0..=255u8),
                1 => bytes[at] = b",\"\n\r;e-"[rng.random_range(0..7)],
                2 => drop(bytes.drain(at..end)),
                3 => bytes.extend_from_within(at..end),
                _ => bytes.truncate(at.max(1)),
            }
        }
        std::fs::write(&path, &bytes).unwrap();
        let mut arguments = vec![path.to_str().unwrap(), "--n", "9", "--model", "linear"];
        arguments.extend(["--iterations", "2", "--starts", "1"]);
        if case % 2 == 0 {
            arguments.push("--skip-bad-rows");
        }
        let result = design(&arguments);
        let said = text(&result.stderr);
        assert!(
            !said.contains("panicked") && !said.is_empty(),
            "case {case}: {said}"
        );
        let code = result.status.code().unwrap();
        assert!(code == 0 || code == 2, "case {case}: {code} {said}");
        *codes.entry(code).or_insert(0) += 1;
    }
    assert!(codes.len() == 2, "both ends are tried: {codes:?}");
}

#[test]
fn help_man_page_and_completions() {
    let help = design(&["--help"]);
    assert_eq!(help.status.code(), Some(0));
    let help = text(&help.stdout);
    assert!(help.lines().count() <= 24, "one screen");
    assert!(
        help.lines().all(|line| line.chars().count() <= 80),
        "{help}"
    );
    // What the man page lists, the screen names.
    let page = text(&design(&["--man"]).stdout)
        .replace("\\-", "-")
        .replace("\\fB", "");
    let mut options = 0;
    for line in page.lines().filter(|l| l.starts_with("--")) {
        let end = line.find(['\\', '=', ' ', ',', '\n']);
        let option = &line[..end.unwrap_or(line.len())];
        assert!(help.contains(option), "{option} is not in --help");
        options += 1;
    }
    assert!(options >= 20, "{options} of {page}");
    assert!(text(&design(&["--man"]).stdout).contains(".TH ecm-design"));
    for shell in ["bash", "zsh", "fish"] {
        assert!(
            text(&design(&["--completions", shell]).stdout).contains("ecm-design"),
            "{shell}"
        );
    }
    assert_eq!(design(&[]).status.code(), Some(2));
}

/// Ctrl-C: the best so far is written and the exit code is 130.
#[cfg(unix)]
#[test]
fn an_interrupted_search_keeps_the_best() {
    let dir = folder("interrupt");
    let path = candidates(&dir, 300);
    let out = dir.join("plan.csv");
    for criterion in ["d", "maximin"] {
        let _ = std::fs::remove_file(&out);
        let child = Command::new(env!("CARGO_BIN_EXE_ecm-design"))
            .args([
                path.to_str().unwrap(),
                "--n",
                "100",
                "--criterion",
                criterion,
            ])
            .args(["--iterations", "1000000000", "--out", out.to_str().unwrap()])
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        std::thread::sleep(std::time::Duration::from_millis(700));
        let id = child.id().to_string();
        assert!(
            Command::new("kill")
                .args(["-INT", &id])
                .status()
                .unwrap()
                .success()
        );
        let result = child.wait_with_output().unwrap();
        assert_eq!(result.status.code(), Some(130), "{}", text(&result.stderr));
        assert!(text(&result.stderr).contains("interrupted: kept the best"));
        assert_eq!(std::fs::read_to_string(&out).unwrap().lines().count(), 101);
    }
}

/// The protocols: the paper's visits each pose once after two seconds; the diagnosable one from two
/// sides, after three dwells, with checks between; effects need what only `ecm design` knows.
#[test]
fn protocols_of_a_plan() {
    let dir = folder("protocols");
    let path = candidates(&dir, 200);
    std::fs::write(dir.join("c.toml"), "[mechanism]\nlength_m = 0.1\n").unwrap();
    let base = [
        path.to_str().unwrap(),
        "--n",
        "30",
        "--criterion",
        "maximin",
    ];
    let base = [&base[..], &["--iterations", "5", "--quiet"]].concat();
    let plan = |preset: &str| -> Vec<Vec<String>> {
        let result = design(&[&base[..], &["--preset", preset]].concat());
        assert_eq!(result.status.code(), Some(0), "{}", text(&result.stderr));
        let mut reader = csv::Reader::from_reader(&result.stdout[..]);
        let header: Vec<String> = reader.headers().unwrap().iter().map(Into::into).collect();
        assert_eq!(
            header[6..],
            [
                "note", "pose_id", "kind", "approach", "dwell_s", "run", "action"
            ]
        );
        let rows = reader
            .records()
            .map(|r| r.unwrap().iter().map(Into::into).collect());
        rows.collect()
    };
    let paper = plan("paper");
    assert_eq!(paper.len(), 30);
    assert!(
        paper
            .iter()
            .all(|r| r[8..] == ["pose", "initial", "2.0", "0", "measure"])
    );
    let rows = plan("diagnosable");
    let poses: Vec<&Vec<String>> = rows.iter().filter(|r| r[8] == "pose").collect();
    assert_eq!(poses.len(), 60);
    let ids: std::collections::HashSet<&str> = poses.iter().map(|r| r[7].as_str()).collect();
    assert_eq!(ids.len(), 30);
    let sides: std::collections::HashSet<&str> = poses.iter().map(|r| r[9].as_str()).collect();
    assert!(sides.len() > 5 && sides.contains("initial"));
    assert!(sides.iter().all(|s| *s == "initial" || ids.contains(s)));
    // From the other side: (p - p_from) M (p - p0) < 0.
    let at = |id: &str| -> Vec<f64> {
        let row = poses.iter().find(|r| r[7] == id).unwrap();
        let rest = [0.1, 0.0, 0.0, 0.0, 0.0, 0.0];
        let unit = [1.0, 1.0, 1.0, 0.1, 0.1, 0.1];
        (0..6)
            .map(|c| unit[c] * (row[c].parse::<f64>().unwrap() - rest[c]))
            .collect()
    };
    for row in poses.iter().filter(|r| r[9] != "initial") {
        let (p, from) = (at(&row[7]), at(&row[9]));
        let side: f64 = (0..6).map(|c| (p[c] - from[c]) * p[c]).sum();
        assert!(side < 0.0, "{row:?} {side}");
    }
    let dwells: std::collections::HashSet<&str> = poses.iter().map(|r| r[10].as_str()).collect();
    assert_eq!(dwells, ["2.0", "8.0", "30.0"].into());
    assert_eq!(rows.iter().filter(|r| r[8] == "home").count(), 7);
    assert_eq!(rows.iter().filter(|r| r[8] == "unloaded").count(), 3);
    for check in rows.iter().filter(|r| r[8] != "pose") {
        assert_eq!(check[..6], ["0.1", "0", "0", "0", "0", "0"]);
        assert_eq!((check[7].as_str(), check[9].as_str()), ("-1", ""));
    }
    let effects = design(&[&base[..], &["--effects", "fts_drift"]].concat());
    assert_eq!(effects.status.code(), Some(2));
    assert!(text(&effects.stderr).contains("ecm design --preset diagnosable --effects"));
    let other = dir.join("o.csv");
    std::fs::write(&other, "a,b\n1,2\n3,4\n5,7\n").unwrap();
    let refused = design(&[
        other.to_str().unwrap(),
        "--n",
        "3",
        "--model",
        "linear",
        "--preset",
        "paper",
    ]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("--preset needs pose columns"));
}
