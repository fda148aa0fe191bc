"""The entry of ``python -m sklearn_mcmd.paper``."""

from sklearn_mcmd._extras import run_app

__all__ = ["main"]


def main(arguments=None):
    """Run the reproductions; without the command line's libraries, say how to install them.

    Raises
    ------
    SystemExit
        Always, with the exit code: 0 done, 1 failed, 2 wrong usage, 130 interrupted.
    """
    run_app("sklearn_mcmd.paper._cli", "paper", arguments, prog_name="python -m sklearn_mcmd.paper")


if __name__ == "__main__":
    main()
