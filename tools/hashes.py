"""Prints the files in a report of pip with their hashes, for `pip install --require-hashes`.

`make hashes` asks pip for the report, and then whether it finds the hashes true. They are the files
of one Python and platform, which the first line names.
"""

import json
import platform
import sys
from pathlib import Path


def main() -> int:
    """Prints the requirements; the exit status is 1 if pip knows a file without a hash."""
    report = json.loads(Path(sys.argv[1]).read_text())
    packages = {}
    for item in report["install"]:
        if "dir_info" in item["download_info"]:
            continue  # this package
        given = item["metadata"]
        hashes = item["download_info"].get("archive_info", {}).get("hashes", {})
        if "sha256" not in hashes:
            print(f"{given['name']}: no hash", file=sys.stderr)
            return 1
        packages[f"{given['name']}=={given['version']}"] = hashes["sha256"]
    where = f"{platform.python_implementation()} {'.'.join(platform.python_version_tuple()[:2])}"
    print(f"# {where}, {platform.system()} {platform.machine()}: written by `make hashes`")
    for name, digest in sorted(packages.items(), key=lambda item: item[0].lower()):
        print(f"{name} --hash=sha256:{digest}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
