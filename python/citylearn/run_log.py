# SPDX-License-Identifier: Apache-2.0
"""Logs runs of any program to the dashboard: `init`, `log`, `finish`, as Weights & Biases has them.

This file needs Python alone and works where it is copied to. What is logged goes to a file first; a thread sends it to the
dashboard, and `sync` sends what a program left that was killed.
"""

import argparse
import atexit
import collections.abc
import contextlib
import http.client
import json
import math
import os
import platform
import re
import secrets
import sys
import threading
import time
import urllib.parse
from pathlib import Path

LOG = "log.jsonl"
MOST_RECORDS = 5000     # of one request
MOST_BYTES = 900_000    # likewise; the dashboard takes 1 MiB
SHORTEST_PAUSE = 0.2    # seconds between two requests: what is logged meanwhile goes together
HEARTBEAT = 2.0         # seconds between two requests while nothing is logged: the run counts as running
LONGEST_PAUSE = 30.0    # seconds between two attempts to reach the dashboard
ANSWER = 30.0           # seconds that one answer may take
LONGEST_NAME = 128      # bytes of the name of a project or a run
LONGEST_METRIC = 256    # bytes
LARGEST_STEP = 1e300


class DashboardError(Exception):
    """The dashboard refused a request for good: a wrong token, or a run that another program logs."""


class Dashboard:
    """Sends records to one dashboard. Used by one thread at a time."""

    def __init__(self, url, token=None):
        try:
            parts = urllib.parse.urlsplit(url if "://" in url else f"http://{url}")
            self._host, self._port = parts.hostname, parts.port
        except ValueError:
            parts = self._host = None
        if not self._host or parts.scheme not in ("http", "https"):
            raise ValueError(f"dashboard '{url}': give an address such as http://127.0.0.1:8080")
        self.url = f"{parts.scheme}://{parts.netloc}"
        self._kind = http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
        self._token = token
        self._connection = None

    def send(self, run, log, first, lines):
        """Sends the records `lines`, of which the first has the number `first`. Returns how many records of the log the
        dashboard has committed. Raises OSError when it cannot be reached or is not well."""
        body = '{"source":"python","log":%s,"first":%d,"records":[%s]}' % (json.dumps(log), first, ",".join(lines))
        status, answer = self._post("/api/runs/" + urllib.parse.quote(run, safe=""), body.encode())
        try:
            said = json.loads(answer)
            if status == 200:
                return int(said["received"])
            said = said["error"]
        except (ValueError, KeyError, TypeError):
            said = f"answers with status {status}, unlike a dashboard of CityLearn-DDS"
        if status >= 500 or status == 429:
            raise OSError(f"{self.url}: {said}")
        raise DashboardError(f"{self.url}: {said}")

    def _post(self, path, body):
        headers = {"Content-Type": "application/json"}
        if self._token:
            headers["Authorization"] = f"Bearer {self._token}"
        kept = self._connection is not None
        try:
            if not kept:
                self._connection = self._kind(self._host, self._port, timeout=ANSWER)
            self._connection.request("POST", path, body, headers)
            answer = self._connection.getresponse()
            return answer.status, answer.read()
        except (OSError, http.client.HTTPException) as error:
            self.close()
            if kept:  # the dashboard closes connections that are idle
                return self._post(path, body)
            raise OSError(f"{self.url} does not answer: {error}") from error

    def close(self):
        if self._connection is not None:
            self._connection.close()
            self._connection = None


def record_of(path, number, line, *texts):
    """Returns a line of a log, a dictionary in JSON that has these texts. Raises ValueError naming the place."""
    with contextlib.suppress(ValueError):
        record = json.loads(line)
        if isinstance(record, dict) and all(isinstance(record.get(name), str) for name in texts):
            return record
    raise ValueError(f"{path}:{number}: this line is damaged: it is no record of a run")


class LogFile:
    """The file of a run's log: one record a line, numbered from 1 on. The first line identifies the log."""

    def __init__(self, folder):
        self.path = Path(folder, LOG)
        self._file = open(self.path, "rb")
        try:
            head = record_of(self.path, 1, self._file.readline(), "run", "log")
        except ValueError:
            self._file.close()
            raise
        self._begin = self._file.tell()
        self.run, self.log = head["run"], head["log"]
        self.next = 1  # number of the record that read() returns first

    def read(self):
        """Returns the next records; an empty list at the end."""
        lines, size = [], 0
        while len(lines) < MOST_RECORDS and size < MOST_BYTES:
            place = self._file.tell()
            line = self._file.readline()
            if not line.endswith(b"\n") or (lines and size + len(line) > MOST_BYTES):
                self._file.seek(place)  # nothing more, or a program is writing it
                break
            lines.append(line[:-1].decode("ascii", "backslashreplace"))  # which JSON refuses
            size += len(line)
        self.next += len(lines)
        return lines

    def go_to(self, number):
        """Lets read() go on with this record."""
        if number < self.next:
            self._file.seek(self._begin)
            self.next = 1
        while self.next < number and self._file.readline().endswith(b"\n"):
            self.next += 1

    def close(self):
        self._file.close()


def send_rest(file, dashboard):
    """Sends all records of a log that the dashboard does not have. Returns how many it has then."""
    received = dashboard.send(file.run, file.log, 1, [])
    while True:
        file.go_to(received + 1)
        first = file.next
        lines = file.read()
        if not lines:
            return received
        before = received
        try:
            received = dashboard.send(file.run, file.log, first, lines)
        except DashboardError:
            for number, line in enumerate(lines, first + 1):
                record_of(file.path, number, line)  # names the line that is damaged
            raise
        if received <= before:
            raise DashboardError(f"{dashboard.url}: takes no more of {file.path}")


class Config(dict):
    """The run's options. Items and attributes are the same, and each change is logged."""

    def __init__(self, changed):
        super().__init__()
        super().__setattr__("_changed", changed)

    def __setitem__(self, key, value):
        self.update({key: value})

    def update(self, *members, **more):
        news = {str(key): value for key, value in dict(*members, **more).items()}
        self._changed(news)
        super().update(news)

    def setdefault(self, key, default=None):
        if key not in self:
            self[key] = default
        return self[key]

    def __getattr__(self, name):
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"there is no '{name}' (there are: {', '.join(map(str, self))})") from None

    def __setattr__(self, name, value):
        self[name] = value


def plain(value):
    """Returns a value as JSON has it. What JSON does not have becomes its text."""
    if isinstance(value, dict):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple, set)):
        return [plain(inner) for inner in value]
    if hasattr(value, "item") and getattr(value, "size", 1) == 1:
        value = value.item()  # of numpy or torch
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)


def figures(data, prefix=""):
    """Returns name -> number of what is logged: names of nested dictionaries are joined by '/'. Of what is no finite number
    the value is None."""
    if not isinstance(data, collections.abc.Mapping):
        raise TypeError(f"log: needs a dictionary of names and numbers, is {type(data).__name__}")
    found = {}
    for key, value in data.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            found.update(figures(value, f"{name}/"))
            continue
        try:
            if isinstance(value, str):
                raise TypeError
            number = float(value.item() if hasattr(value, "item") else value)
        except (TypeError, ValueError):
            raise TypeError(f"log: '{name}' must be a number, is {type(value).__name__} (texts belong into config)") from None
        except OverflowError:
            number = math.inf  # a whole number beyond all floats
        if not name.isprintable() or not 0 < len(name.encode()) <= LONGEST_METRIC:
            raise ValueError(f"log: the name {name[:40]!r} must be one line of 1 to {LONGEST_METRIC} bytes")
        found[name] = number if math.isfinite(number) else None
    return found


class Run:
    """One run that is logged. `init` makes it.

    id: its ID on the dashboard, PROJECT/NAME.  dir: the folder of its log.  config: its options.  summary: final figures that
    the dashboard shows in place of the last values.
    """

    def __init__(self, folder, head, dashboard, beginning):
        self.id, self.dir, self._log = head["run"], str(folder), head["log"]
        self.step = 0  # of the next log() without a step
        self.config = Config(lambda news: self._write({"config": plain(news)}))
        self.summary = Config(lambda news: self._write({"summary": plain(news)}))
        self._lock = threading.Lock()
        self._owner = os.getpid()  # children that are forked log too; only this process sends
        self._file = os.open(Path(folder, LOG), os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o600)
        self._finished = False
        self._sender = None
        if os.fstat(self._file).st_size == 0:
            self._append(json.dumps(head))
        self._write({"begin": beginning})
        if dashboard is not None:
            self._sender = Sender(folder, dashboard)

    def log(self, data, step=None):
        """Logs the numbers of a dictionary, at a step (by default one more than the last). When it returns, they are in the
        run's file and survive the end of the program, whatever it is. Raises OSError when the file cannot be written, and
        TypeError for what is no number."""
        values = figures(data)
        with self._lock:
            if step is None:
                step = self.step
            elif getattr(step, "size", 0) == 1:
                step = step.item()  # of numpy
            if not isinstance(step, (int, float)) or not -LARGEST_STEP <= step <= LARGEST_STEP:
                raise TypeError(f"log: step must be a finite number, is {step!r:.40}")
            self._record({"step": step, "time": round(time.time(), 3), "values": values})
            self.step = math.floor(step) + 1

    def finish(self, wait=10.0):
        """Ends the run, and waits until the dashboard has everything. Returns True then. Returns False, and says what sends
        the rest, when the dashboard has not gone on for `wait` seconds."""
        if self._finished or os.getpid() != self._owner:
            return True
        self._write({"end": round(time.time(), 3)})
        self._finished = True
        os.close(self._file)
        if self._sender is None:
            return True
        left = self._sender.finish(wait)
        if left:
            print(f"citylearn: {self._sender.problem or 'the dashboard is slow'}. All is in {self.dir}; later send it with: "
                  f"python3 -m citylearn.sync {self.dir}", file=sys.stderr)
        return not left

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.finish()

    def _write(self, record):
        with self._lock:
            self._record(record)

    def _record(self, record):
        if self._finished:
            raise RuntimeError(f"run {self.id} is finished: citylearn.init() begins another one")
        self._append(json.dumps(record, separators=(",", ":"), allow_nan=False))
        if self._sender is not None and os.getpid() == self._owner:
            self._sender.wake()

    def _append(self, text):
        line = text.encode() + b"\n"
        if len(line) > MOST_BYTES:
            raise ValueError(f"run {self.id}: a record of {len(line)} bytes is too large: log fewer figures at once")
        written = os.write(self._file, line)
        if written != len(line):  # the disk is full: nothing of it is acknowledged
            os.ftruncate(self._file, os.fstat(self._file).st_size - written)
            raise OSError(f"{self.dir}/{LOG}: no space left")


class Sender:
    """The thread that sends a run's log."""

    def __init__(self, folder, dashboard):
        self._file, self._dashboard = LogFile(folder), dashboard
        self._news, self._stop = threading.Event(), threading.Event()
        self.received = 0     # records that the dashboard has
        self.problem = ""     # why it gets no more now; empty: it does
        self._done = threading.Event()
        self._progress = time.monotonic()
        self._thread = threading.Thread(target=self._work, name="citylearn", daemon=True)
        self._thread.start()

    def wake(self):
        self._news.set()

    def finish(self, wait):
        """Waits until all is sent, or nothing more has been for `wait` seconds. Returns whether something is left."""
        self._stop.set()
        self._progress = time.monotonic()
        self._news.set()
        while not self._done.wait(0.05):
            if time.monotonic() - self._progress > wait or not self._thread.is_alive():
                return True
        return bool(self.problem)

    def _work(self):
        try:
            self._send_until_finished()
        except Exception as error:  # the program goes on, whatever it is, and finish() says it
            self.problem = f"{type(error).__name__}: {error}"
        finally:
            self._file.close()
            self._dashboard.close()
            self._done.set()

    def _send_until_finished(self):
        pause = 1.0
        while True:
            self._news.wait(HEARTBEAT)
            self._news.clear()
            stop = self._stop.is_set()
            try:
                self._send()
                self.problem, pause = "", 1.0
                self._stop.wait(SHORTEST_PAUSE)
            except DashboardError as error:
                self.problem = str(error)
                print(f"citylearn: {error}; the run is logged to {self._file.path} alone", file=sys.stderr)
                return
            except OSError as error:
                if not self.problem:
                    print(f"citylearn: {error}; the run is logged to {self._file.path} and sent later", file=sys.stderr)
                self.problem = str(error)
                if self._stop.wait(pause):
                    time.sleep(SHORTEST_PAUSE)
                pause = min(2 * pause, LONGEST_PAUSE)
                self._news.set()
                continue
            if stop:
                return

    def _send(self):
        while True:
            first = self._file.next
            lines = self._file.read()
            received = self._dashboard.send(self._file.run, self._file.log, first, lines)
            if received > self.received:
                self._progress = time.monotonic()
            self.received = received
            if received + 1 != self._file.next:  # it had some already, or has lost some
                self._file.go_to(received + 1)
                continue
            if not lines:
                return


def escaped(name, what):
    if not isinstance(name, str):
        raise TypeError(f"{what} must be a text, is {name!r}")
    if not name.isprintable() or not 0 < len(name.encode()) <= LONGEST_NAME:
        raise ValueError(f"{what} {name[:40]!r} must be one line of 1 to {LONGEST_NAME} bytes")
    return name.replace("%", "%25").replace("/", "%2F")


def default_token(token_file):
    file = token_file or os.environ.get("CITYLEARN_TOKEN_FILE")
    token = Path(file).read_text().strip() if file else os.environ.get("CITYLEARN_TOKEN")
    if token and not (token.isascii() and token.isprintable()):
        raise ValueError(f"{file or '$CITYLEARN_TOKEN'}: a token is one line of ASCII letters, digits and signs")
    return token


def default_dashboard():
    return os.environ.get("CITYLEARN_DASHBOARD", "http://127.0.0.1:8080")


def repair(path):
    """Takes away the last line of a log if a program was killed while it wrote it: it was never acknowledged."""
    with open(path, "r+b") as file:
        text = file.read()
        file.truncate(text.rfind(b"\n") + 1)


_current = None


def init(project="default", name=None, config=None, *, title="", tags=(), note="", dir=None, dashboard=None, token_file=None,
         resume=False, offline=False):
    """Begins a run and makes it the one that `citylearn.log` logs to. Returns it.

    project, name: its ID on the dashboard is PROJECT/NAME. Without a name it gets one from the time and chance.
    config: its options, a dictionary; more can be set later: run.config.rate = 0.1.
    title, tags, note: for people.
    dir: the folder of its log; by default RUNS/logged/PROJECT-NAME, where RUNS is $CITYLEARN_RUNS or "runs".
    dashboard: its address; by default $CITYLEARN_DASHBOARD or http://127.0.0.1:8080.
    token_file: the file with the dashboard's token; by default $CITYLEARN_TOKEN_FILE, or the token in $CITYLEARN_TOKEN.
    resume: go on with the log that is in `dir`, of a program that has ended.
    offline: write the log alone; `python3 -m citylearn.sync DIR` sends it.

    Raises FileExistsError when the folder has a log and `resume` is not given.
    """
    global _current
    if _current is not None:
        _current.finish()
    if not isinstance(config or {}, collections.abc.Mapping):
        raise TypeError(f"config must be a dictionary, is {type(config).__name__}")
    title, tags, note = title or "", tags or (), note or ""
    if isinstance(tags, str) or not all(isinstance(tag, str) for tag in tags):
        raise TypeError(f"tags must be a list of texts, is {tags!r}")
    if not isinstance(title, str) or not isinstance(note, str):
        raise TypeError(f"title and note must be texts, are {title!r} and {note!r}")
    name = name or f"{time.strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(3)}"
    run = f"{escaped(project, 'project')}/{escaped(name, 'name')}"
    folder = Path(dir or Path(os.environ.get("CITYLEARN_RUNS", "runs"), "logged", re.sub(r"[^\w.-]", "-", f"{project}-{name}")))
    sender = None if offline else Dashboard(dashboard or default_dashboard(), default_token(token_file))
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / LOG
    head, step = {"run": run, "log": secrets.token_hex(8), "started": round(time.time(), 3)}, 0
    if log.exists() and log.stat().st_size > 0:
        if not resume:
            raise FileExistsError(f"{log} is the log of another run: choose another name or dir, or resume=True")
        repair(log)
        with open(log, "rb") as file:
            if line := file.readline():
                head = {**head, **record_of(log, 1, line, "run", "log")}
            for number, line in enumerate(file, 2):
                logged = record_of(log, number, line).get("step", -1)
                step = max(step, math.floor(logged) + 1 if isinstance(logged, (int, float)) else 0)
    beginning = {"started": head["started"], "title": title, "tags": list(tags), "note": note}
    _current = Run(folder, head, sender, beginning)
    _current.step = step
    options = {"program": " ".join([Path(sys.argv[0] or "python").name, *sys.argv[1:]])[:1000], "host": platform.node(),
               "python": platform.python_version()}
    _current.config.update({"system": options, **(config or {})})
    return _current


def log(data, step=None):
    """Logs the numbers of a dictionary to the run that `init` began: see Run.log."""
    if _current is None:
        raise RuntimeError("citylearn.log: call citylearn.init() first")
    _current.log(data, step)


def finish(wait=10.0):
    """Ends the run that `init` began: see Run.finish."""
    global _current
    if _current is None:
        return True
    run, _current = _current, None
    return run.finish(wait)


def _after_fork():
    if _current is not None:
        _current._lock = threading.Lock()  # another thread of the parent may have held it


atexit.register(finish)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def sync(folder, dashboard=None, token_file=None):
    """Sends the logs of runs in a folder, and in those below it, as far as the dashboard does not have them. Returns
    [(ID of the run, records that the dashboard has)]. A log that is damaged (ValueError) or refused (DashboardError) is
    an error after the others are sent."""
    problems = []
    sent = list(send_logs(folder, dashboard, token_file, problems))
    if problems:
        raise problems[0]
    return sent


def send_logs(folder, dashboard, token_file, problems):
    """Yields what `sync` returns, and adds an exception to `problems` for each log that cannot be sent."""
    logs = sorted(Path(folder).rglob(LOG))
    if not logs:
        raise FileNotFoundError(f"{folder}: holds no {LOG}, the log of a run")
    with contextlib.closing(Dashboard(dashboard or default_dashboard(), default_token(token_file))) as to:
        for path in logs:
            with open(path, "rb") as begun:
                if not begun.readline().endswith(b"\n"):
                    continue  # its program was killed before it logged anything
            try:
                with contextlib.closing(LogFile(path.parent)) as file:
                    yield file.run, send_rest(file, to)
            except ValueError as error:
                problems.append(error)
            except DashboardError as error:
                problems.append(DashboardError(f"{path}: {error}"))


def main(arguments=None):
    parser = argparse.ArgumentParser(
        prog="citylearn sync", description="Sends logs of runs to the dashboard: what killed or offline programs left.")
    parser.add_argument("DIR", nargs="+", help="folder of a run's log, or one above several")
    parser.add_argument("--dashboard", default=None, metavar="URL",
                        help="address of the dashboard (default: $CITYLEARN_DASHBOARD or http://127.0.0.1:8080)")
    parser.add_argument("--token-file", default=None, metavar="FILE", help="file with the dashboard's token")
    given = parser.parse_args(arguments)
    problems = []
    try:
        for folder in given.DIR:
            for run, records in send_logs(folder, given.dashboard, given.token_file, problems):
                print(f"{run}: the dashboard has all {records} records")
    except (OSError, ValueError) as error:
        problems.append(error)
    for problem in problems:
        print(f"citylearn sync: {problem}", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
