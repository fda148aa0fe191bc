"""The entry of ``python -m sklearn_mcmd.paper``."""

import sys

__all__ = ["main"]


def main(arguments=None):
    """Run the reproductions; without the command line's libraries, say how to get them.

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
            f"paper: error: the command line needs {err.name}, which is not installed: "
            'pip install "sklearn-mcmd[cli]"',
            file=sys.stderr,
        )
        sys.exit(1)
    from sklearn_mcmd.paper._cli import app

    app(arguments, prog_name="python -m sklearn_mcmd.paper")


if __name__ == "__main__":
    main()
