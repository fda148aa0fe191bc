"""The entry of ``mcmd`` and ``python -m sklearn_mcmd``."""

from sklearn_mcmd._extras import run_app

__all__ = ["main"]


def main():
    """Run the command line; without its libraries, say in one line how to get them.

    Raises
    ------
    SystemExit
        Always, with the exit code: 0 done, 1 failed, 2 wrong usage, 130 interrupted.
    """
    run_app("sklearn_mcmd.cli", "mcmd", prog_name="mcmd")


if __name__ == "__main__":
    main()
