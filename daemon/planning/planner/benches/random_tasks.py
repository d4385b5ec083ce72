#!/usr/bin/env python3
"""Checks on random small tasks that the least cost found by brute force is the one that Fast Downward proves.

usage: random_tasks.py FOLDER [--every N]

FOLDER is the result of:

    mkdir FOLDER; ALTHING_TASKS=10000 ALTHING_TASKS_FOLDER=FOLDER \\
        cargo test --release -p planner --test it planner_and_brute_force_agree

Fast Downward (`pip install up-fast-downward`) searches each task with `astar(blind())`. Differences are printed, and
the exit code is 1 if there are any.
"""
import argparse, concurrent.futures, importlib.util, os, pathlib, re, subprocess, sys, tempfile

NO_PLAN = (11, 12)


def driver():
    found = importlib.util.find_spec("up_fast_downward")
    if found is None:
        sys.exit("Fast Downward is not installed: `pip install up-fast-downward`")
    return pathlib.Path(found.origin).parent / "downward/fast-downward.py"


def least(driver, domain, problem):
    """Returns the result of Fast Downward: `none`, a cost, or the reason why there is neither."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, driver, domain, problem, "--search", "astar(blind())"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
        if done.returncode in NO_PLAN:
            return "none"
        cost = re.search(r"Plan cost: (\d+)", done.stdout)
        if done.returncode == 0 and cost:
            return cost[1]
        return f"exit code {done.returncode}: {(done.stderr.strip() or done.stdout.strip()).splitlines()[-1:]}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--every", type=int, default=1)
    args = parser.parse_args()
    costs = sorted(args.folder.resolve().glob("*-cost"))[:: args.every]
    if not costs:
        sys.exit(f"{args.folder}: there is no task (*-cost)")
    fast_downward, differing, unread = driver(), 0, 0

    def judge(cost):
        task = str(cost).removesuffix("-cost")
        return cost, least(fast_downward, f"{task}-domain.pddl", f"{task}-problem.pddl")

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for number, (cost, found) in enumerate(pool.map(judge, costs), 1):
            truth = cost.read_text()
            if found.startswith("exit code"):
                unread += 1
                print(f"{cost.name}: {found}")
            elif found != truth:
                differing += 1
                print(f"{cost.name}: brute force {truth}, Fast Downward {found}")
            if number % 500 == 0:
                print(f"{number} of {len(costs)}", file=sys.stderr)
    print(f"{len(costs)} tasks: {differing} differ, {unread} not judged")
    sys.exit(1 if differing or unread else 0)


main()
