#!/usr/bin/env python3
"""Compares the embedded planner with another one on competition tasks, on the same machine in the same hour.

usage: competition.py BENCH [--set classical|numeric] [--time 30] [--core N] [--other 'CMD'] [--only ALTHING|OTHER]
                      [--anytime] [--every N]

BENCH is a folder with SET.tasks (a line per task: `DOMAIN PROBLEM`, files in SET/) and SET/. Run `cargo build
--release` first. Results go to target/competition/NAME/SET/*.jsonl, where NAME is the last part of BENCH. A second
run continues where they end; `rm -r target/competition` starts anew. The other planner of the classical set is Fast
Downward (`pip install up-fast-downward`) with `--alias lama-first`; --other names a different one, with {domain}
{problem} {plan}. Each planner gets one core, 2 GiB and an empty PATH, and `althing validate` checks its plans. Prints
Markdown.

With --anytime, both search for cheaper plans after the first one until the time limit (`--anytime` and `--alias
lama`), and the cheapest counts. --every 4 takes every fourth task only.

The agile score is that of the competitions: 1 for a task solved within a second, then less on a logarithmic scale,
and 0 at the time limit.
"""
import argparse, contextlib, importlib.util, json, math, os, pathlib, re, resource, shlex, shutil, signal, subprocess, sys
import tempfile, time

ROOT = pathlib.Path(__file__).resolve().parents[4]
ALTHING = ROOT / "target/release/althing"


def command_of_fast_downward(alias):
    found = importlib.util.find_spec("up_fast_downward")
    if found is None:
        sys.exit("Fast Downward is not installed: `pip install up-fast-downward`, or name another planner with --other")
    driver = pathlib.Path(found.origin).parent / "downward/fast-downward.py"
    return f"{sys.executable} {driver} --plan-file {{plan}} --alias {alias} {{domain}} {{problem}}"


def task_lines(bench, which, every):
    """Returns the lines of a list of tasks, `DOMAIN PROBLEM` each, or only every `every`th of them."""
    return [line for line in open(pathlib.Path(bench) / f"{which}.tasks") if line.split("#")[0].split()][::every]


def confine(core):
    """Returns a function that limits the planner's process before the planner runs: one core, 2 GiB."""
    def begin():
        resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
        if core is not None:
            os.sched_setaffinity(0, {core})
    return begin


def newest(plan):
    """Returns the plan file, or the last one if there are several (`plan.1`, `plan.2`, …)."""
    numbered = [path for path in plan.parent.glob(plan.name + ".*") if path.suffix[1:].isdigit()]
    return max(numbered, key=lambda path: int(path.suffix[1:]), default=plan)


def cost_of(text):
    """Returns the cost that is written in a plan, or its number of actions if there is none."""
    said = re.findall(r"^;\s*cost\s*[=:]\s*([0-9.eE+]+)", text, re.MULTILINE)
    return float(said[-1]) if said else float(sum("(" in line.split(";")[0] for line in text.splitlines()))


def attempt(command, domain, problem, args, kept=None):
    """Runs the planner once, and returns the row for the results. The plan is copied to the file `kept`."""
    with tempfile.TemporaryDirectory() as folder:
        plan = pathlib.Path(folder) / "plan"
        words = [word.format(domain=domain, problem=problem, plan=plan) for word in shlex.split(command)]
        began = time.monotonic()
        child = subprocess.Popen(words, cwd=folder, env={**os.environ, "PATH": ""}, start_new_session=True,
                                 preexec_fn=confine(args.core), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            child.wait(args.time)
        except subprocess.TimeoutExpired:
            pass
        # Kills all processes that the planner has started.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()
        wall = time.monotonic() - began
        found = newest(plan)
        if not found.exists():
            return {"solved": False, "valid": None, "wall": wall, "cost": None}
        if kept is not None:
            shutil.copy(found, kept)
        judge = subprocess.run([ALTHING, "validate", domain, problem, found], capture_output=True)
        valid = judge.returncode == 0
        return {"solved": valid, "valid": valid, "wall": wall, "cost": cost_of(found.read_text())}


def run(command, args, out):
    """Runs the planner on each task that is not in the results yet."""
    done = rows(out)
    for line in task_lines(args.bench, args.set, args.every):
        domain, problem = line.split("#")[0].split()[:2]
        if (domain, problem) in done:
            continue
        root = pathlib.Path(args.bench).resolve() / args.set
        row = attempt(command, root / domain, root / problem, args)
        with open(out, "a") as results:
            print(json.dumps({"domain": domain, "problem": problem, **row}), file=results)


def rows(path):
    if not path.exists():
        return {}
    return {(row["domain"], row["problem"]): row for row in map(json.loads, open(path))}


def agile(row, limit):
    if not row["solved"]:
        return 0
    return 1 if row["wall"] <= 1 else max(0, 1 - math.log(row["wall"]) / math.log(limit))


def mean_ratio(pairs):
    logs = [math.log(own / other) for own, other in pairs if own and other]
    return math.exp(sum(logs) / len(logs)) if logs else math.nan


def cell(row):
    if row is None:
        return "not run"
    if not row["solved"]:
        return "–"
    return f"{row['cost']:g} in {row['wall']:.2f} s"


def tell(args, own, other):
    keys = [key for key in own if key in other] or list(own)
    both = [key for key in keys if own[key]["solved"] and other.get(key, {}).get("solved")]
    print(f"| {len(keys)} {args.set} tasks, {args.time:g} s, 2 GiB, one core | althing | other |\n|---|---|---|")
    sides = [[side[key] for key in keys if key in side] for side in (own, other)]
    print("| solved |", " | ".join(str(sum(row["solved"] for row in side)) for side in sides), "|")
    print("| agile score |", " | ".join(f"{sum(agile(row, args.time) for row in side):.1f}" for side in sides), "|")
    print("| plans that the validator refuses |", " | ".join(str(sum(row["valid"] is False for row in side)) for side in sides), "|")
    costs = mean_ratio((own[key]["cost"], other[key]["cost"]) for key in both)
    times = mean_ratio((own[key]["wall"], other[key]["wall"]) for key in both)
    print(f"| cost of plans for the {len(both)} that both solve, geometric mean of ratios | {costs:.3f} | 1 |")
    print(f"| time for them, likewise | {times:.3f} | 1 |\n")
    print("Solved by one of them only, or by neither:\n\n| task | althing | other |\n|---|---|---|")
    for key in sorted(keys):
        pair = own[key], other.get(key)
        if not all(row and row["solved"] for row in pair):
            print("|", key[1], "|", cell(pair[0]), "|", cell(pair[1]), "|")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bench")
    parser.add_argument("--set", default="classical", choices=["classical", "numeric"])
    parser.add_argument("--time", type=float, default=30)
    parser.add_argument("--core", type=int)
    parser.add_argument("--other", default=None)
    parser.add_argument("--only", choices=["althing", "other"])
    parser.add_argument("--anytime", action="store_true")
    parser.add_argument("--every", type=int, default=1)
    args = parser.parse_args()
    name = pathlib.Path(args.bench).resolve().name
    folder = ROOT / "target/competition" / name / (args.set + ("-anytime" if args.anytime else ""))
    folder.mkdir(parents=True, exist_ok=True)
    results = {name: folder / f"{name}.jsonl" for name in ("althing", "other")}
    further = " --anytime" if args.anytime else ""
    alias = "lama" if args.anytime else "lama-first"
    commands = {
        # Less than the 2 GiB, because code and stacks need memory too.
        "althing": f"{ALTHING} plan {{domain}} {{problem}} --plan {{plan}} --memory-limit 1800 --time-limit {args.time - 0.2:g}{further}",
        "other": args.other or (command_of_fast_downward(alias) if args.set == "classical" and args.only != "althing" else None),
    }
    for name, command in commands.items():
        if command and args.only in (None, name):
            run(command, args, results[name])
    tell(args, *(rows(results[name]) for name in ("althing", "other")))


if __name__ == "__main__":
    main()
