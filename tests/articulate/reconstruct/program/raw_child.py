"""A stand-in for child.py without guard and interpreter: runs a program as plain Python.

What holds it then is the lockdown alone. The test puts two lines before this text: ROOT, the
folder of the package, and MODULES, what the program imports, loaded before the door shuts so
that an attack fails at what it does and not at an import.
"""

import json
import os
import sys

ROOT = ""
MODULES = [""]

settings = json.loads(sys.argv[1])
sys.path.append(ROOT)

from articulate.reconstruct.program.process_limits import restrict_process  # noqa: E402  # needs the path above
from articulate.reconstruct.program.values import AxisBox, Vector  # noqa: E402

for name in MODULES:
    __import__(name)


def box(part):
    return AxisBox(Vector(0, 0, 0), Vector(1, 1, 1))


def parts():
    return ["part_0"]


def vec(x, y, z):
    return Vector(x, y, z)


def place(part, position=None, rpy=None):
    return None


def say(content):
    os.write(1, json.dumps(content).encode() + b"\n")


say({"layers": restrict_process(**settings)})
rest = b""
while not rest.endswith(b"\n"):
    rest += os.read(0, 65536)
given = {"box": box, "parts": parts, "vec": vec, "place": place, "__name__": "program"}
try:
    exec(json.loads(rest)["source"], given)  # that is the point
    say({"ended": "ran"})
except BaseException as error:  # noqa: BLE001  # an attack raises anything
    say({"ended": type(error).__name__, "text": str(error)[:200]})
