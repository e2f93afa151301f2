"""Feeds many changed inputs to whoever reads files and words, and tells what happened.

    python tools/fuzz.py --inputs 100000 --seed 1
    python tools/fuzz.py --through-commands 300 --seed 1

The second one starts a command for each input. The exit status is 1 if anything but an answer or
one line about the input came of one of them.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from helpers.fuzzing import Fuzzer
from helpers.fuzzing_commands import CommandFuzzer

# of a hundred
SHARES = {
    "configuration": 33,
    "command line": 30,
    "policy file": 16,
    "policy contents": 8,
    "race checkpoint": 4,
    "run of mdpo-ipc": 4,
    "RDDL": 4,
    "run folder": 1,
}
COMMAND_SHARES = {
    "configuration": 25,
    "command line": 25,
    "policy file": 20,
    "run of mdpo-ipc": 10,
    "RDDL": 20,
}


def main() -> int:
    """Runs the inputs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--through-commands", type=int, metavar="N")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    started = time.monotonic()
    commands = options.through_commands
    with tempfile.TemporaryDirectory() as folder:
        fuzzer: Fuzzer | CommandFuzzer
        if commands is None:
            fuzzer, shares, inputs = Fuzzer(Path(folder), options.seed), SHARES, options.inputs
        else:
            fuzzer, shares = CommandFuzzer(Path(folder), options.seed), COMMAND_SHARES
            inputs = commands
        for kind, share in shares.items():
            for _ in range(share * inputs // 100):
                fuzzer.run(kind)
            refused, accepted = fuzzer.outcomes.get(kind, (0, 0))
            print(f"{kind}: {refused:,} refused, {accepted:,} accepted", flush=True)
    seconds = round(time.monotonic() - started)
    for failure in fuzzer.failures[:20]:
        print(failure)
    print(json.dumps({"seconds": seconds, "failures": len(fuzzer.failures), **fuzzer.outcomes}))
    return int(bool(fuzzer.failures))


if __name__ == "__main__":
    sys.exit(main())
