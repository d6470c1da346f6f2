"""The command line: parse, call, print; no logic. Entry point: `app.main`."""
