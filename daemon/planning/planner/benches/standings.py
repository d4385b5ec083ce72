#!/usr/bin/env python3
"""Plays whole boards of the planning competitions, beside other planners, and writes how each planner stands.

usage: standings.py play ROWS [--classical TREE] [--numeric TREE] [--board BOARD]... [--peer 'NAME=CMD']...
                    [--time 30] [--core N] [--minutes M] [--thirds-only] [--althing CMD]
       standings.py page ROWS [--before ROWS] [--out FILE]

The boards are `ipc-2018` (240 tasks of the satisficing track), `ipc-2023` (140, satisficing and agile), both from
the TREE of aibasel/downward-benchmarks; `suite`, a third of the satisficing folders there, drawn by a seed; and
`ipc-2023-numeric` (400), from the TREE of ipc2023-numeric/ipc2023-dataset.

`play` adds a row for each task to ROWS/BOARD/PLANNER.jsonl, and keeps the plan beside it. It goes on where the rows
end, and stops after --minutes. Althing plays every task, the peers a third of each domain, in the same order, task by
task: first the third that all play, then the rest. Each process has one core, 2 GiB and an empty PATH. CMD is a
command with {domain}, {problem} and {plan}; a peer named `enhsp` plays only the numeric board, all others only the
classical ones. `althing validate` judges the plans; `--time` and the planners must stay the same within ROWS.

`page` writes Markdown: the text of ROWS/remarks.md if it is there, the counts of each board and domain, and the tasks
that only one planner solves. With --before, the rows of another version, it also names each task that was solved
there and is not solved here, and ends with exit code 1 if there is one.

The cost of a plan is that of its metric, on the numeric board its number of steps.

The agile score is that of the competitions: 1 for a task solved within a second, then less on a logarithmic scale,
and 0 at the time limit.
"""
import argparse, datetime, json, pathlib, random, sys, time

from competition import ROOT, agile, attempt, mean_ratio, rows
from draw_tasks import domain_of

ALTHING = f"{ROOT}/target/release/althing-plan {{domain}} {{problem}} --plan {{plan}} --memory-limit 1800 --time-limit {{limit}}"
PATTERNS = {"ipc-2018": "*-sat18-*", "ipc-2023": "*-sat23-*", "suite": "*", "ipc-2023-numeric": "*"}
NUMERIC = "ipc-2023-numeric"
HEAD = """# Standings

Whole boards of the planning competitions, beside other planners. The estimator was chosen before the first task ran:

- A task is *solved* if a plan file is there when the time is over or the process ends, and `althing validate` accepts it. Each process has {limit:g} s of wall-clock time, reading included, 2 GiB of address space and one core. The first plan counts.
- The *agile score* of a task is 1 up to a second, then 1 − ln(time) ÷ ln({limit:g}), and 0 at the limit.
- The other planners play every third task of each domain, task by task in turns with Althing, so that they meet the same load. Ratios are geometric means over the tasks that both solve.
- Domains take turns. A board that is not finished is a sample of all of its domains, and the counts say how large it is.

Made by `daemon/planning/planner/benches/standings.py page ROWS --out docs/standings.md`, from rows that `standings.py play ROWS …` has written ([planner.md](planner.md) names the sources of the tasks). `--before ROWS` names each task that an earlier version solved and this one does not.
"""

# Of the suite, each of three parts has the same number of tasks of a domain; the seed says which.
SUITE_SEED = 1
THIRD = 3


def folders(board, tree):
    for folder in sorted(path for path in tree.glob(PATTERNS[board]) if path.is_dir()):
        if board != "suite" or not any(track in folder.name for track in ("-opt", "-mco", "-sat18-", "-sat23-")):
            yield folder


def tasks_of(board, folder):
    """Returns (domain, problem) for each task of a folder, as paths within its tree."""
    if board == NUMERIC:
        problems = sorted((folder / "instances").glob("*.pddl"), key=lambda path: (len(path.name), path.name))
        return [(f"{folder.name}/domain.pddl", f"{folder.name}/instances/{path.name}") for path in problems]
    files = sorted(path.name for path in folder.glob("*.pddl"))
    pairs = [(domain_of(name, files), name) for name in files if "domain" not in name]
    return [(f"{folder.name}/{domain}", f"{folder.name}/{name}") for domain, name in pairs if domain]


def tasks(board, tree):
    """Returns the tasks of a board in the order of play, with whether the peers play them, too.

    The domains take turns, so that rows that end early are of all domains alike."""
    shared, further = [], []
    for folder in folders(board, tree):
        of_folder = tasks_of(board, folder)
        if board == "suite":
            random.Random(f"{SUITE_SEED} {folder.name}").shuffle(of_folder)
            of_folder = of_folder[::THIRD]
        for index, task in enumerate(of_folder):
            (shared if index % THIRD == 1 else further).append((index, folder.name, task))
    return [(task, True) for _, _, task in sorted(shared)] + [(task, False) for _, _, task in sorted(further)]


def play(args):
    ends = time.monotonic() + args.minutes * 60
    peers = dict(peer.split("=", 1) for peer in args.peer)
    for board in args.board or PATTERNS:
        tree = args.numeric if board == NUMERIC else args.classical
        if tree is None:
            continue
        players = {"althing": args.althing} | {name: cmd for name, cmd in peers.items() if (name == "enhsp") == (board == NUMERIC)}
        done = {name: rows(args.rows / board / f"{name}.jsonl") for name in players}
        for task, is_shared in tasks(board, tree):
            for name, command in players.items():
                if task in done[name] or name != "althing" and not is_shared or args.thirds_only and not is_shared:
                    continue
                if time.monotonic() > ends:
                    sys.exit(f"stopped after {args.minutes:g} minutes; the same command goes on")
                play_one(args, board, tree, name, command, task)


def play_one(args, board, tree, name, command, task):
    plans = args.rows / board / name
    plans.mkdir(parents=True, exist_ok=True)
    command = command.replace("{limit}", f"{args.time - 0.2:g}")
    domain, problem = task
    kept = plans / problem.replace("/", "+")
    row = attempt(command, tree.resolve() / domain, tree.resolve() / problem, args, kept)
    if board == NUMERIC and row["cost"] is not None:
        # ENHSP does not write what a plan costs by the metric.
        row["cost"] = steps_of(kept.read_text())
    today = datetime.date.today().isoformat()
    with open(args.rows / board / f"{name}.jsonl", "a") as results:
        print(json.dumps({"domain": domain, "problem": problem, **row, "limit": args.time, "date": today}), file=results)


def steps_of(plan):
    return sum("(" in line.split(";")[0] for line in plan.splitlines())


def folder_of(key):
    return key[1].split("/")[0]


def score(results, keys):
    return f"{sum(results[key]['solved'] for key in keys)}; {sum(agile(results[key], results[key]['limit']) for key in keys):.1f}"


def page_of_board(board, results):
    """Returns the lines about a board: a row per domain, and the tasks on which the planners differ."""
    own = results["althing"]
    peers = [name for name in results if name != "althing"]
    shared = [key for key in own if peers and all(key in results[name] for name in peers)]
    dates = sorted({row["date"] for row in own.values()})
    lines = [f"## {board}", "", f"{len(own)} tasks by Althing, {len(shared)} of them by all, {' to '.join(sorted({dates[0], dates[-1]}))}.", ""]
    lines += [f"| solved; agile score | tasks | althing | tasks of all | althing | {' | '.join(peers)} |", "|---|---|---|---|---|" + "---|" * len(peers)]
    for folder in [None, *sorted({folder_of(key) for key in own})]:
        ours = [key for key in own if folder in (None, folder_of(key))]
        both = [key for key in shared if folder in (None, folder_of(key))]
        cells = [folder or "**all**", str(len(ours)), score(own, ours), str(len(both)), *(score(results[name], both) for name in ["althing", *peers])]
        lines.append(f"| {' | '.join(cells)} |")
    lines.append("")
    refused = sum(row["valid"] is False for row in own.values())
    lines.append(f"Plans of Althing that the validator refuses: {refused}.")
    for name in peers:
        pairs = [(own[key], results[name][key]) for key in shared]
        both = [(a, b) for a, b in pairs if a["solved"] and b["solved"]]
        lines.append(f"Beside {name}, {len(both)} solved by both: {'steps' if board == NUMERIC else 'cost'} {mean_ratio((a['cost'], b['cost']) for a, b in both):.3f}, "
                     f"time {mean_ratio((a['wall'], b['wall']) for a, b in both):.3f} of its (geometric means of ratios).")
        for side, word in ((True, "Only Althing solves"), (False, f"Only {name} solves")):
            keys = [key[1] for key in shared if own[key]["solved"] == side and results[name][key]["solved"] != side]
            lines.append(f"{word} {len(keys)}" + (f": {', '.join(f'`{key}`' for key in sorted(keys))}." if keys else "."))
    return lines + [""]


def results_of(folder):
    found = {}
    for path in sorted(folder.glob("*.jsonl"), key=lambda path: (path.stem != "althing", path.stem)):
        found[path.stem] = rows(path)
    return found


def page(args):
    lines, lost = [], []
    for board in PATTERNS:
        results = results_of(args.rows / board)
        if "althing" not in results:
            continue
        if not lines:
            limit = next(iter(results["althing"].values()))["limit"]
            remarks = args.rows / "remarks.md"
            lines += [*HEAD.format(limit=limit).splitlines(), "", *(remarks.read_text().splitlines() if remarks.exists() else []), ""]
        lines += page_of_board(board, results)
        before = results_of(args.before / board).get("althing", {}) if args.before else {}
        lost += [key[1] for key, row in before.items() if row["solved"] and not results["althing"].get(key, row)["solved"]]
    if args.before:
        lines += [f"Solved before, and not now: {len(lost)}{': ' if lost else ''}{', '.join(f'`{key}`' for key in sorted(lost))}.", ""]
    text = "\n".join(lines)
    args.out.write_text(text) if args.out else print(text)
    sys.exit(1 if lost else 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = parser.add_subparsers(required=True)
    playing = parts.add_parser("play")
    playing.set_defaults(part=play)
    playing.add_argument("rows", type=pathlib.Path)
    playing.add_argument("--classical", type=pathlib.Path)
    playing.add_argument("--numeric", type=pathlib.Path)
    playing.add_argument("--board", action="append", choices=PATTERNS)
    playing.add_argument("--peer", action="append", default=[])
    playing.add_argument("--althing", default=ALTHING)
    playing.add_argument("--time", type=float, default=30)
    playing.add_argument("--core", type=int)
    playing.add_argument("--minutes", type=float, default=float("inf"))
    playing.add_argument("--thirds-only", action="store_true")
    writing = parts.add_parser("page")
    writing.set_defaults(part=page)
    writing.add_argument("rows", type=pathlib.Path)
    writing.add_argument("--before", type=pathlib.Path)
    writing.add_argument("--out", type=pathlib.Path)
    args = parser.parse_args()
    args.part(args)


if __name__ == "__main__":
    main()
