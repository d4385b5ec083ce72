"""Runs a program under a filter of calls, as a service manager does: `filtered.py RULES PROGRAM …`.

RULES is JSON: `allowed`, the numbers of calls (all, if it is missing); `errors`, numbers with the error that
each gets; `other`, the error of what is not allowed; `machine`, the AUDIT_ARCH of this machine.
"""
import ctypes
import json
import os
import struct
import sys

RULES = json.loads(sys.argv[1])
LOAD, EQUAL, RETURN, ALLOW, ERROR, KILL = 0x20, 0x15, 0x06, 0x7FFF0000, 0x00050000, 0x80000000


def step(code, yes, no, value):
    return struct.pack("HBBI", code, yes, no, value)


def when(number, answer):
    return [step(EQUAL, 0, 1, number), step(RETURN, 0, 0, answer)]


program = [step(LOAD, 0, 0, 4), step(EQUAL, 1, 0, RULES["machine"]), step(RETURN, 0, 0, KILL), step(LOAD, 0, 0, 0)]
for number, error in RULES["errors"]:
    program += when(number, ERROR | error)
for number in RULES.get("allowed") or []:
    program += when(number, ALLOW)
program.append(step(RETURN, 0, 0, ERROR | RULES["other"] if "allowed" in RULES else ALLOW))
text = ctypes.create_string_buffer(b"".join(program), 8 * len(program))


class Filter(ctypes.Structure):
    _fields_ = [("length", ctypes.c_ushort), ("program", ctypes.c_void_p)]


libc = ctypes.CDLL(None, use_errno=True)
filter = Filter(len(program), ctypes.addressof(text))
if libc.prctl(38, 1, 0, 0, 0) or libc.prctl(22, 2, ctypes.byref(filter), 0, 0):
    sys.exit(f"no filter: {os.strerror(ctypes.get_errno())}")
os.execvp(sys.argv[2], sys.argv[2:])
