"""Asks unified-planning's validator about plans: one task for each line of standard input.

A line holds three paths, separated by tabs: domain, problem, plan. The answer is a line for each:
`valid`, `invalid: REASON`, or `unreadable: REASON` where unified-planning cannot read the PDDL.
"""

import sys
import warnings

warnings.simplefilter("ignore")

from unified_planning.engines.plan_validator import SequentialPlanValidator
from unified_planning.engines.results import ValidationResultStatus
from unified_planning.io import PDDLReader


def one_line(problem):
    return " ".join(f"{type(problem).__name__}: {problem}".split())


def judge(domain, problem, plan):
    try:
        reader = PDDLReader()
        task = reader.parse_problem(domain, problem)
        steps = reader.parse_plan(task, plan)
    except Exception as err:  # Whatever it stumbles over, it has not understood the task.
        return f"unreadable: {one_line(err)}"
    try:
        result = SequentialPlanValidator().validate(task, steps)
    except Exception as err:
        return f"unreadable: {one_line(err)}"
    if result.status == ValidationResultStatus.VALID:
        return "valid"
    return f"invalid: {result.reason} {result.log_messages}"


for line in sys.stdin:
    print(judge(*line.rstrip("\n").split("\t")), flush=True)
