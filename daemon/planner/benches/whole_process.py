#!/usr/bin/env python3
"""A building's problem, from the start of a process to its end: `althing plan` beside Fast Downward.

usage: whole_process.py [--starts 30] [--core N] [--build release|dist]

The office of `office/` (the paper's Scenario 1: robots, thermometers, rooms), in words that Fast Downward reads: agents are
first parameters, distances whole numbers. Both plan from the same two files and write a plan, in turns, each in a fresh
process; of Fast Downward that is its driver with `--alias lama-first`. Prints the medians and their ratio, once both have
found a plan that `althing validate` accepts. Before: `cargo build --release` (or `--profile dist`, what packages are made
of), and `pip install up-fast-downward`.
"""
import argparse, pathlib, re, statistics, subprocess, sys, tempfile, time

from competition import ROOT, command_of_fast_downward

OFFICE = pathlib.Path(__file__).parent / "office"
AIM = 50


def plainly(text):
    """The same without agents and fractions."""
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
    althing = ROOT / "target" / args.build / "althing"
    pinned = ["taskset", "-c", str(args.core)] if args.core is not None else []
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        domain, problem = folder / "domain.pddl", folder / "problem.pddl"
        for file in (domain, problem):
            file.write_text(plainly((OFFICE / file.name).read_text()))
        plans = {"althing": folder / "ours.plan", "Fast Downward": folder / "theirs.plan"}
        other = command_of_fast_downward("lama-first")
        commands = {
            "althing": [althing, "plan", domain, problem, "--plan", plans["althing"]],
            "Fast Downward": other.format(domain=domain, problem=problem, plan=plans["Fast Downward"]).split(),
        }
        times = {name: [] for name in commands}
        for _ in range(args.starts):
            for name, command in commands.items():
                plans[name].unlink(missing_ok=True)
                times[name].append(took(pinned + command))
        for plan in plans.values():
            took([althing, "validate", domain, problem, plan])
    ours, theirs = (statistics.median(times[name]) for name in commands)
    print(f"althing plan {ours:.2f} ms, Fast Downward {theirs:.0f} ms: {theirs / ours:.0f} times as fast, "
          f"aim >= {AIM}: {'reached' if theirs / ours >= AIM else 'missed'}")


main()
