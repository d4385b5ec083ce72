#!/usr/bin/env python3
"""Checks plans for competition tasks with a validator of another project: unified-planning's.

usage: second_opinion.py BENCH [--set classical|numeric] [--time 30] [--core N]

BENCH is a folder with SET.tasks and SET/, as for competition.py. Run `cargo build --release` and `pip install
unified-planning` first. `althing-plan` plans for each task within --time seconds and 2 GiB. Each plan is reported as
`valid`, `invalid` or `unreadable`, with the reason, and the exit code is 1 unless all are valid.

unified-planning cannot read everything that the competitions write. So the tasks are changed first, in ways that do
not affect whether a plan is valid: metrics are left out; `total-cost` begins with 0 if the problem gives no value; a
predicate with the name of a function, which nothing can use, is removed; and so are values of functions that are not
declared.
"""
import argparse, os, pathlib, re, subprocess, sys, tempfile, warnings

from competition import ROOT, task_lines

warnings.simplefilter("ignore")

PROGRAM = ROOT / "target/release/althing-plan"


def section(text, begins):
    """Returns where the first expression with this beginning starts and ends; `None` if there is none."""
    start = text.find(begins)
    if start < 0:
        return None
    depth = 0
    for at in range(start, len(text)):
        depth += {"(": 1, ")": -1}.get(text[at], 0)
        if depth == 0:
            return start, at + 1
    return None


def without(text, begins):
    found = section(text, begins)
    return text[: found[0]] + text[found[1] :] if found else text


def readable(domain, problem):
    """Returns the same task in a form that unified-planning can read."""
    problem = without(problem, "(:metric")
    if "total-cost" in domain and not re.search(r"\(=\s*\(\s*total-cost", problem):
        problem = problem.replace("(:init", "(:init (= (total-cost) 0)", 1)
    functions, predicates = section(domain, "(:functions"), section(domain, "(:predicates")
    if functions and predicates:
        named = set(re.findall(r"\(\s*([\w-]+)", domain[slice(*functions)]))
        value = r"\(=\s*\(\s*([\w-]+)[^()]*\)\s*[-\d.]+\s*\)"
        problem = re.sub(value, lambda told: told.group(0) if told.group(1) in named else "", problem)
        kept = re.sub(
            r"\(\s*([\w-]+)[^()]*\)",
            lambda declared: "" if declared.group(1) in named else declared.group(0),
            domain[predicates[0] + 1 : predicates[1] - 1],
        )
        domain = f"{domain[: predicates[0]]}({kept}){domain[predicates[1] :]}"
    return domain, problem


def judge(domain, problem, plan):
    from unified_planning.engines.plan_validator import SequentialPlanValidator
    from unified_planning.engines.results import ValidationResultStatus
    from unified_planning.io import PDDLReader

    try:
        reader = PDDLReader()
        task = reader.parse_problem_string(*readable(domain, problem))
        steps = reader.parse_plan(task, str(plan))
        validator = SequentialPlanValidator()
        # Its own checks refuse what it supports: products of numbers that never change.
        validator.skip_checks = True
        result = validator.validate(task, steps)
    except Exception as err:  # After any exception the task counts as not read.
        return f"unreadable: {' '.join(f'{type(err).__name__}: {err}'.split())[:200]}"
    if result.status == ValidationResultStatus.VALID:
        return "valid"
    return f"invalid: {result.reason}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bench")
    parser.add_argument("--set", default="numeric", choices=["classical", "numeric"])
    parser.add_argument("--time", type=float, default=30)
    parser.add_argument("--core", type=int)
    args = parser.parse_args()
    if args.core is not None:
        os.sched_setaffinity(0, {args.core})
    root = pathlib.Path(args.bench) / args.set
    verdicts = []
    with tempfile.TemporaryDirectory() as folder:
        for line in task_lines(args.bench, args.set, 1):
            domain, problem = (root / word for word in line.split()[:2])
            plan = pathlib.Path(folder) / "plan"
            plan.unlink(missing_ok=True)
            limits = ["--time-limit", str(args.time - 0.2), "--memory-limit", "1800"]
            command = [PROGRAM, domain, problem, "--plan", plan, *limits]
            subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            if not plan.exists():
                continue
            verdicts.append(judge(domain.read_text(), problem.read_text(), plan))
            print(f"{line.split()[1]}: {verdicts[-1]}", flush=True)
    valid = sum(verdict == "valid" for verdict in verdicts)
    print(f"{valid} of {len(verdicts)} plans are valid")
    sys.exit(valid != len(verdicts))


if __name__ == "__main__":
    main()
