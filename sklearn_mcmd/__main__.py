"""The entry of ``mcmd`` and ``python -m sklearn_mcmd``."""


def main():
    """Run the command line; without its libraries, say in one line how to get them.

    Always raises SystemExit, with the exit code: 0 done, 1 failed, 2 wrong usage, 130 interrupted.
    """
    try:  # imports above this line would run before Ctrl-C is handled
        _run()
    except KeyboardInterrupt:
        import os

        os.write(2, b"mcmd: interrupted\n")
        os._exit(130)  # Python would end by the signal if code in a string was interrupted


def _run():
    import os
    import sys

    from sklearn_mcmd._extras import import_extra
    from sklearn_mcmd.runtime._interrupts import INTERRUPTED, handle_signals, ignore_interrupts

    handle_signals("mcmd")
    try:
        for library in ("rich", "typer"):
            import_extra(library, "cli", "the command line")
    except ImportError as err:
        print(f"mcmd: error: {err}", file=sys.stderr)
        sys.exit(1)
    from sklearn_mcmd.cli import app

    try:
        app(prog_name="mcmd")
    except SystemExit as end:
        if end.code == INTERRUPTED:
            # Threads may still compile or compute; do not wait for them.
            os._exit(INTERRUPTED)
        ignore_interrupts()
        raise


if __name__ == "__main__":
    main()
