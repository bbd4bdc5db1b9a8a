"""`viable` and `python -m viable`: the program that belongs to the package."""

import os
import sys

from ._paths import find_program, make_environment


def main() -> None:
    os.execve(find_program(), ["viable", *sys.argv[1:]], make_environment())


if __name__ == "__main__":
    main()
