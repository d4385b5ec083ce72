#!/usr/bin/env python3
"""Draws competition tasks by a seed, so that the planner is measured on tasks that it was not tuned to.

usage: draw_tasks.py TREE OUT [--seed N] [--per-domain N] [--without BENCH]

TREE has a folder per domain, as the repository aibasel/downward-benchmarks. Writes OUT/classical.tasks and a link
OUT/classical to TREE; OUT is then the BENCH of competition.py. Folders for the optimal and the multi-core tracks
(`-opt`, `-mco` in the name) are left out, and so are the folders that BENCH/classical.tasks names, and problems that
are the same file as one of BENCH. Variants of a domain of BENCH under another name stay.
"""
import argparse, hashlib, pathlib, random


def domain_of(problem, files):
    """Returns the domain file of a problem file, by the naming customs of the competitions; None if there is none."""
    stem = problem.removesuffix(".pddl")
    customs = ["domain.pddl", f"{stem}-domain.pddl", f"domain_{problem}", f"domain-{problem}", f"{stem[:3]}-domain.pddl"]
    return next((name for name in customs if name in files), None)


def digest(path):
    return hashlib.sha256(path.read_bytes()).digest()


def draw(tree, rng, per_domain, without, known):
    for folder in sorted(path for path in tree.iterdir() if path.is_dir()):
        if "-opt" in folder.name or "-mco" in folder.name or folder.name in without:
            continue
        files = sorted(path.name for path in folder.glob("*.pddl"))
        pairs = [(domain_of(name, files), name) for name in files if "domain" not in name]
        pairs = [pair for pair in pairs if pair[0] and digest(folder / pair[1]) not in known]
        for domain, problem in rng.sample(pairs, min(per_domain, len(pairs))):
            yield f"{folder.name}/{domain} {folder.name}/{problem}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tree", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--per-domain", type=int, default=2)
    parser.add_argument("--without", type=pathlib.Path)
    args = parser.parse_args()
    if not args.tree.is_dir():
        parser.error(f"{args.tree} is not a folder; clone aibasel/downward-benchmarks, for example")
    if args.without and not (args.without / "classical.tasks").is_file():
        parser.error(f"{args.without} has no classical.tasks")
    link = args.out / "classical"
    if link.exists() and not link.is_symlink():
        parser.error(f"{link} is a folder of its own: {args.out} is not one that this program has made")
    without, known = set(), set()
    if args.without:
        tasks = [line.split() for line in open(args.without / "classical.tasks")]
        without = {problem.split("/")[0] for _, problem in tasks}
        known = {digest(args.without / "classical" / problem) for _, problem in tasks}
    lines = list(draw(args.tree, random.Random(args.seed), args.per_domain, without, known))
    if not lines:
        parser.error(f"{args.tree} has no folder with tasks")
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "classical.tasks").write_text("".join(f"{line}\n" for line in lines))
    link.unlink(missing_ok=True)
    link.symlink_to(args.tree.resolve())
    print(f"{len(lines)} tasks of {len({line.split('/')[0] for line in lines})} domains in {args.out / 'classical.tasks'}")


if __name__ == "__main__":
    main()
