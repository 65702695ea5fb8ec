"""The whole matrix: ``python -m tests.boundary``; it takes some minutes and prints what is wrong."""

import sys

from tests.boundary.matrix import Judge, cases


def main() -> int:
    judge, count, complaints = Judge(), 0, 0
    only = sys.argv[1] if len(sys.argv) > 1 else ""
    for case in cases():
        if only not in case.door.name:
            continue
        count += 1
        found = judge.complaint(case)
        if found is not None:
            complaints += 1
            print(f"{case.name}: {found}", flush=True)
    name, seconds = judge.slowest
    print(f"{count} cases, {dict(judge.outcomes)}; {complaints} complaints; slowest {seconds:.1f} s: {name}")
    return int(complaints > 0)


if __name__ == "__main__":
    sys.exit(main())
