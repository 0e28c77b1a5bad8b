"""The program ends as Python would end it, and sooner."""
import os
import subprocess
import sys

import pytest

from tests.test_start_up import ROOT

PROGRAM = """
import atexit, os, sys, threading, time
from concurrent.futures import ThreadPoolExecutor
from spectrabox.session.leaving import run_and_leave

def main():
{body}

{call}
"""
BUFFERED = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
BODIES = {
    "returns": "print('done')",
    "exit code": "sys.exit(4)",
    "no exit code": "sys.exit()",
    "sentence": "sys.exit('it failed')",
    "error": "raise ValueError('it failed')",
    "no newline": "sys.stdout.write('done'); sys.stderr.write('told')",
    "called at exit": "atexit.register(print, 'tidied up'); sys.exit(5)",
    "thread": "threading.Thread(target=lambda: (time.sleep(0.2), print('late'))).start()",
    # its threads wait for more work and are no daemons: whoever only waits for them waits for ever
    "pool left open": "ThreadPoolExecutor(1).submit(print, 'done').result()",
    "no output": "sys.stdout = None; sys.stderr = None",
    "output closed": "sys.stdout.close(); sys.exit(3)",
}


def ended(body, call, stdout=subprocess.PIPE):
    """Exit code, output and last line of the errors of a program."""
    source = PROGRAM.format(body=f"    {body}", call=call)
    ran = subprocess.run([sys.executable, "-c", source], env=BUFFERED, cwd=ROOT, stdout=stdout,
                         stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    return ran.returncode, ran.stdout, ran.stderr.splitlines()[-1:]


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_a_program_ends_as_python_ends_it(body):
    assert ended(body, "run_and_leave(main)") == ended(body, "main()")


@pytest.mark.skipif(sys.platform != "linux", reason="needs /dev/full")
def test_output_that_cannot_be_written_is_no_success():
    codes = []
    for call in ("run_and_leave(main)", "main()"):
        with open("/dev/full", "w") as full:    # noqa: PTH123 - as a file that takes nothing
            codes.append(ended("print('done')", call, stdout=full)[0])
    assert codes == [120, 120]


def test_nothing_is_taken_apart():
    body = ("sys.kept = type('Kept', (), {'__del__': lambda self, say=os.write: "
            "say(1, b'taken apart')})(); sys.exit(3)")
    assert ended(body, "main()")[:2] == (3, "taken apart")
    assert ended(body, "run_and_leave(main)")[:2] == (3, "")
