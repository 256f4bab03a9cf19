"""`python -m tests.golden`: compare what the commands write with the goldens, or write the goldens anew."""

import argparse
import sys
import tempfile
from pathlib import Path

from .workshop import chosen, compare, is_same_machine, run, update, update_machine


def main() -> int:
    """Return 1 if a result differs from its golden, otherwise 0."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--check", action="store_true", help="compare with the goldens (the default)")
    what.add_argument("--update", action="store_true", help="write the goldens anew")
    parser.add_argument("names", nargs="*", help="cases; all if none is named")
    options = parser.parse_args()
    try:
        cases = chosen(options.names)
    except KeyError as unknown:
        parser.error(f"there is no case {unknown}; the cases are {', '.join(one.name for one in chosen([]))}")
    if options.update:
        if options.names and not is_same_machine():
            parser.error("this machine is not that of the other goldens; update all of them")
        update_machine()
    same = is_same_machine()
    if not same:
        print("This machine is not that of the goldens: only the structure of results is compared.")
    failed, spent = [], 0.0
    with tempfile.TemporaryDirectory() as folder:
        for outcome in run(cases, Path(folder)):
            spent += outcome.seconds
            name = outcome.case.name
            found: list[str] = []
            if outcome.code != outcome.case.code:
                found = [f"exit code {outcome.code}. {outcome.refusal}"]
            elif options.update:
                update(outcome)
            else:
                found = compare(outcome, same_machine=same)
            print(f"{name}: {len(found)} differences, {outcome.seconds:.1f} s", flush=True)
            for one in found:
                print(f"  {one}")
            failed += [name] if found else []
    print(f"{spent:.0f} s of computing. {f'These differ: {failed}' if failed else 'Nothing differs.'}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
