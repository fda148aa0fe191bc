"""The entry of ``mcmd`` and ``python -m sklearn_mcmd``."""

__all__ = ["main"]


def main():
    """Run the command line; without its libraries, say in one line how to get them.

    Always raises SystemExit, with the exit code: 0 done, 1 failed, 2 wrong usage, 130 interrupted.
    """
    try:  # imports above this line would run before Ctrl-C is handled
        from sklearn_mcmd._extras import run_app

        run_app()
    except KeyboardInterrupt:
        import os

        os.write(2, b"mcmd: interrupted\n")
        os._exit(130)  # Python would end by the signal if code in a string was interrupted


if __name__ == "__main__":
    main()
