"""The entry of ``mcmd`` and ``python -m sklearn_mcmd``."""

import sys

__all__ = ["main"]


def main():
    """Run the command line; without its libraries, say in one line how to get them.

    Raises
    ------
    SystemExit
        Always, with the exit code: 0 done, 1 failed, 2 wrong usage, 130 interrupted.
    """
    try:
        import rich  # noqa: F401
        import typer  # noqa: F401
    except ImportError as err:
        print(
            f"mcmd: error: the command line needs {err.name}, which is not installed: "
            'pip install "sklearn-mcmd[cli]"',
            file=sys.stderr,
        )
        sys.exit(1)
    try:
        from sklearn_mcmd.cli import app

        app(prog_name="mcmd")
    except KeyboardInterrupt:  # while modules are imported; the verbs see to their own time
        print("mcmd: error: interrupted", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
