#!/usr/bin/env python3
"""Compares whole processes, from start to end, on a building's problem: `althing-plan` and Fast Downward.

usage: whole_process.py [--starts 30] [--core N] [--build release|dist]

The problem is the office of `office/` (the paper's Scenario 1: robots, thermometers, rooms), in a form that Fast
Downward reads: agents are first parameters, distances are whole numbers. Three programs plan from the same two files
and write a plan, in turns, each in a new process: `althing-plan`, `althing plan` (the same in the daemon's program),
and Fast Downward's driver with `--alias lama-first`. Prints the medians and their ratios if `althing validate`
accepts all plans. Run `cargo build --release` (or `--profile dist`, of which packages are made) and `pip install
up-fast-downward` first.
"""
import argparse, os, pathlib, re, statistics, subprocess, sys, tempfile, time

from competition import ROOT, command_of_fast_downward

OFFICE = pathlib.Path(__file__).parent / "office"
AIM = 50


def plainly(text):
    """Returns the text without agents and fractions."""
    text = re.sub(r":agent (\?\S+ - \S+)\s*:parameters \(", r":parameters (\1 ", text)
    return text.replace(":multi-agent ", "").replace("8.5", "8")


def took(command):
    began = time.perf_counter()
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: ended with {done.returncode}")
    return (time.perf_counter() - began) * 1e3


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("--starts", type=int, default=30)
    parser.add_argument("--core", type=int)
    parser.add_argument("--build", default="release")
    args = parser.parse_args()
    build = ROOT / "target" / args.build
    if args.core is not None:
        # Also for the processes that it starts; `taskset` would be one more process each time.
        os.sched_setaffinity(0, {args.core})
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        domain, problem = folder / "domain.pddl", folder / "problem.pddl"
        for file in (domain, problem):
            file.write_text(plainly((OFFICE / file.name).read_text()))
        other = command_of_fast_downward("lama-first")
        plans = {name: folder / f"{name}.plan" for name in ("althing-plan", "althing plan", "fast-downward")}
        tasks = [domain, problem, "--plan"]
        commands = {
            "althing-plan": [build / "althing-plan", *tasks, plans["althing-plan"]],
            "althing plan": [build / "althing", "plan", *tasks, plans["althing plan"]],
            "fast-downward": other.format(domain=domain, problem=problem, plan=plans["fast-downward"]).split(),
        }
        times = {name: [] for name in commands}
        for _ in range(args.starts):
            for name, command in commands.items():
                plans[name].unlink(missing_ok=True)
                times[name].append(took(command))
        for plan in plans.values():
            took([build / "althing", "validate", domain, problem, plan])
    small, whole, theirs = (statistics.median(times[name]) for name in commands)
    print(f"Fast Downward {theirs:.0f} ms; `althing plan` {whole:.2f} ms, {theirs / whole:.0f} times as fast; "
          f"`althing-plan` {small:.2f} ms, {theirs / small:.0f} times, "
          f"aim >= {AIM}: {'reached' if theirs / small >= AIM else 'missed'}")


main()
