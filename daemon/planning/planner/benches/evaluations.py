#!/usr/bin/env python3
"""Compares the states evaluated per second of search: the embedded planner and Fast Downward, both as `lama-first`.

usage: evaluations.py BENCH [--time 20] [--core N] [--every N]

BENCH is a folder with classical.tasks and classical/. Run `cargo build --release` and `pip install up-fast-downward`
first. Each planner gets each task for --time seconds in all, one planner after the other. A task counts, solved or
not, if both planners search for more than a second. The time before the search (reading, grounding, landmarks) is not
counted. If Fast Downward is stopped, its last progress line is taken. Prints Markdown.
"""
import argparse, json, os, pathlib, re, shlex, signal, statistics, subprocess, tempfile

from competition import ALTHING, command_of_fast_downward, task_lines

# Fast Downward's output about its progress, and at the end of a search.
PROGRESS = re.compile(r"\[t=([\d.]+)s.*?\] g=\d+, (\d+) evaluated")
EVALUATED = re.compile(r"Evaluated (\d+) state")
SEARCH_TIME = re.compile(r"Search time: ([\d.]+)s")
# Shorter searches do not count.
SECONDS_MIN = 1


def run(words, seconds, folder):
    """Returns what a command printed until it ended or its time was over; then kills it with its children."""
    process = subprocess.Popen(words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True)
    try:
        return process.communicate(timeout=seconds)[0]
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        return process.communicate()[0]


def own(domain, problem, seconds, folder):
    """Returns the number of evaluations of the embedded planner, and its seconds of search."""
    words = [ALTHING, "plan", domain, problem, "--search", "lama-first", "--json", "--time-limit", seconds]
    printed = run([str(word) for word in words], seconds + 10, folder)
    figures = json.loads(printed).get("statistics", {}) if printed else {}
    return figures.get("evaluations", 0), figures.get("search_seconds") or 0


def other(domain, problem, seconds, folder):
    """Returns the number of evaluations of Fast Downward, and its seconds of search."""
    command = command_of_fast_downward("lama-first").format(domain=domain, problem=problem, plan=folder / "plan")
    printed = run(shlex.split(command), seconds, folder)
    evaluated, took = EVALUATED.search(printed), SEARCH_TIME.search(printed)
    if evaluated and took:
        return int(evaluated[1]), float(took[1])
    told = PROGRESS.findall(printed)
    return (int(told[-1][1]), float(told[-1][0]) - float(told[0][0])) if told else (0, 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bench", type=pathlib.Path)
    parser.add_argument("--time", type=float, default=20)
    parser.add_argument("--core", type=int)
    parser.add_argument("--every", type=int, default=1)
    args = parser.parse_args()
    if args.core is not None:
        os.sched_setaffinity(0, {args.core})
    ratios = []
    print("| task | althing, evaluations/s | other | ratio |\n|---|---|---|---|")
    for line in task_lines(args.bench, "classical", args.every):
        names = line.split()[:2]
        domain, problem = (args.bench / "classical" / name for name in names)
        with tempfile.TemporaryDirectory() as folder:
            sides = [side(domain.resolve(), problem.resolve(), args.time, pathlib.Path(folder)) for side in (own, other)]
        if all(took > SECONDS_MIN for _, took in sides):
            mine, theirs = (count / took for count, took in sides)
            ratios.append(mine / theirs)
            print(f"| {names[1]} | {mine:,.0f} | {theirs:,.0f} | {ratios[-1]:.2f} |", flush=True)
    if ratios:
        print(f"\n{len(ratios)} tasks, median of ratios {statistics.median(ratios):.2f}")
    else:
        print("\nno task that both search for so long")


if __name__ == "__main__":
    main()
