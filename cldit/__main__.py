"""`python -m cldit` is the command `cldit`."""

from cldit.cli import main

if __name__ == "__main__":
    main(prog_name="cldit")
