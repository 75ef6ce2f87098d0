"""Runs the commands of a plan on a Ray cluster: python ray_many.py plan.json [report.json]

plan.json is what `splatweaver plan list.toml --json` prints. Every command is a unit of work: a worker that dies takes nothing with it, since the
command goes on, or says that it is complete, wherever Ray starts it again. Exit code 75 is a failure of the machine, and is tried again; others are not.
"""

import json
import os
import subprocess
import sys

import ray

#: Program and processors of a unit.
PROGRAM = os.environ.get("SPLATWEAVER", "splatweaver")
THREADS = int(os.environ.get("THREADS_PER_UNIT", "1"))
TRIES = 5
MACHINE = 75


class MachineFailure(Exception):
    """Another machine, or this one later, may do better."""


@ray.remote(num_cpus=THREADS, max_retries=TRIES, retry_exceptions=[MachineFailure])
def run(command, folder):
    words = [PROGRAM, *command[1:], "--threads", str(THREADS)]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    last = (done.stderr.strip().splitlines() or [""])[-1]
    if done.returncode == MACHINE:
        raise MachineFailure(last)
    return {"command": command, "code": done.returncode, "said": last}


def main():
    plan = json.load(open(sys.argv[1]))
    ray.init(address=os.environ.get("RAY_ADDRESS"))
    folder = os.getcwd()
    waiting = []
    for unit in plan:
        memory = {"memory": int(unit["megabytes"] * 1e6)} if unit["megabytes"] else {}
        waiting.append(run.options(**memory).remote(unit["command"], folder))
    results = []
    while waiting:
        (done,), waiting = ray.wait(waiting)
        try:
            results.append(ray.get(done))
        except Exception as error:  # A unit that failed is no reason to lose the others.
            results.append({"command": None, "code": MACHINE, "said": str(error)})
        print(f"{len(results)} of {len(plan)}: {results[-1]['said']}", flush=True)
    if len(sys.argv) > 2:
        json.dump(results, open(sys.argv[2], "w"), indent=1)
    failed = [result for result in results if result["code"] != 0]
    for result in failed:
        print("failed:", result["command"], result["said"], file=sys.stderr)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
