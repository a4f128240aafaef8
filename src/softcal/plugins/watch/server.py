"""Serves a page until it is told to end: that of a run, or any application that one makes of NiceGUI."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
import tempfile
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from inspect import isawaitable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softcal.errors import Fault, InputError
from softcal.extras import require_extra
from softcal.plugins.watch.gate import Gate, is_loopback, new_token
from softcal.plugins.watch.reading import Unreadable, read_file
from softcal.plugins.watch.report_figures import figure_bytes
from softcal.plugins.watch.run_reader import REPORT

if TYPE_CHECKING:
    from fastapi import FastAPI

    from softcal.plugins.watch.packets import Packets
    from softcal.plugins.watch.watch import Watch

LOOPBACK, PORT, FURTHER = "127.0.0.1", 8085, 50
MOST_PAGES = 30  # at once, of half a megabyte to four each, by the numbers of trials and parameters
_REPORT_POLICY = "sandbox; default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'; font-src data:"
# What NiceGUI raises by a message without the entries of the page's own.
_NOT_THE_PAGE_S = (LookupError, TypeError, ValueError, AttributeError)


def serve(folder: Path, *, host: str = LOOPBACK, port: int | None = None, ready: Callable[[str], None]) -> None:
    """Serve the page of a folder until Ctrl-C or another signal.

    Parameters
    ----------
    folder
        The run.
    host
        Address of this machine.
    port
        Any free one where 0; None for the first free one from 8085 on.
    ready
        Called with the page's address when it answers.

    Raises
    ------
    InputError
        Where NiceGUI is not installed, or the port or the address cannot be had.
    KeyboardInterrupt
        When it is ended.
    """
    require_extra("watch", "nicegui", where="softcal watch")
    with ExitStack() as stack:

        def application() -> Any:
            app, watch = _application(folder)
            stack.callback(watch.twins.close)
            return app

        serve_application(application, host=host, port=port, ready=ready)


def serve_application(
    application: Callable[[], Any], *, host: str, port: int | None, ready: Callable[[str], None], most_bytes: int = 0
) -> None:
    """Serve an application until Ctrl-C or another signal.

    Parameters
    ----------
    application
        Makes it, when the port is there.
    host, port, ready
        See `serve`.
    most_bytes
        Of a file that it takes in; 0 where it takes none.

    Raises
    ------
    InputError
        Where the port or the address cannot be had.
    KeyboardInterrupt
        When it is ended.
    """
    host = host.strip("[]")  # of an IPv6 address, as in a URL
    if not host:  # which the system would take for all addresses of the machine
        allowed = "an address of this machine, such as 127.0.0.1"
        raise InputError(Fault("the page cannot be served at this address", "--host", "nothing", allowed))
    with ExitStack() as stack:
        listening = stack.enter_context(_listening(host, port))
        number: int = listening.getsockname()[1]
        token = "" if is_loopback(host) else new_token()
        # What NiceGUI would keep beside the present folder; nothing is kept.
        os.environ["NICEGUI_STORAGE_PATH"] = stack.enter_context(tempfile.TemporaryDirectory(prefix="softcal-page-"))
        app = application()
        # A page on all addresses of the machine is called by the machine's name.
        name = socket.gethostname() if host in ("0.0.0.0", "::") else f"[{host}]" if ":" in host else host
        address = f"http://{name}:{number}/" + (f"?token={token}" if token else "")
        server = _server(Gate(app, token, number, most_bytes), lambda: ready(address))
        server.run(sockets=[listening])


def _listening(host: str, port: int | None) -> socket.socket:
    """A socket that listens on the port, or on the first free one."""
    wanted = range(PORT, PORT + FURTHER) if port is None else (port,)
    problem = ""
    for number in wanted:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        found = socket.socket(family, socket.SOCK_STREAM)
        try:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            found.bind((host, number))
            found.listen(100)
        except (OSError, OverflowError, TypeError, UnicodeError) as error:  # of names that can be none
            found.close()
            problem = getattr(error, "strerror", None) or str(error)
        else:
            return found
    host = host if host.isprintable() else repr(host)
    named = f"{host}:{wanted[0]}" if len(wanted) == 1 else f"{host}:{wanted[0]} to {wanted[-1]}"
    raise InputError(
        Fault("the page cannot be served at this address", named, problem.lower(), attempt="another --port or --host")
    )


def _application(folder: Path) -> tuple[Any, Watch]:
    """The application, and what its pages share."""
    from fastapi import FastAPI
    from fastapi.responses import HTMLResponse, PlainTextResponse, Response

    from softcal.plugins.watch.page import RunPage
    from softcal.plugins.watch.watch import Watch

    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    watch = Watch(folder)

    def report() -> Response:
        try:
            text = read_file(folder, REPORT)
        except Unreadable as error:
            return PlainTextResponse(f"{error}\n", status_code=404)
        if text is None:
            return PlainTextResponse("There is no report yet.\n", status_code=404)
        return HTMLResponse(text, headers={"content-security-policy": _REPORT_POLICY})

    def twin(name: str) -> Response:
        glb = next((one.glb for one in watch.twins.shapes() if one.name == name), b"")
        return Response(glb, media_type="model/gltf-binary") if glb else PlainTextResponse("", status_code=404)

    def figure(name: str) -> Response:
        png = figure_bytes(folder, name)
        return Response(png, media_type="image/png") if png else PlainTextResponse("", status_code=404)

    def fit(name: str) -> Response:
        shown = (one for shape in watch.twins.shapes() for one in shape.fits)
        png = next((one.png for one in shown if one.name == name), b"")
        return Response(png, media_type="image/png") if png else PlainTextResponse("", status_code=404)

    app.get("/report")(report)
    app.get("/fit/{name}.png")(fit)
    app.get("/twin/{name}.glb")(twin)
    app.get("/figures/{name}")(figure)

    return with_page(app, "softcal watch", lambda: RunPage(watch)), watch


def with_page(app: FastAPI, title: str, page: Callable[[], object]) -> Packets:
    """An application with a page of NiceGUI at its root, for so many browsers as `MOST_PAGES`.

    Parameters
    ----------
    app
        The other addresses.
    title
        Title of the page.
    page
        Makes the elements of one browser's page.
    """
    from fastapi import Depends, HTTPException, Request
    from fastapi.responses import PlainTextResponse, Response
    from nicegui import Client, core, ui

    from softcal.plugins.watch.packets import Packets

    style = Path(__file__).with_name("page.css").read_text(encoding="utf-8")

    def styled() -> None:
        ui.add_css(style)
        page()

    async def room() -> None:
        """Make room for one more page: those that no browser is connected to, which NiceGUI keeps for a minute, go."""
        if len(Client.instances) >= MOST_PAGES:
            Client.prune_instances(client_age_threshold=0.0)
        if len(Client.instances) >= MOST_PAGES:
            raise HTTPException(503, f"This page is open in {MOST_PAGES} other browsers: close one of them.")

    async def sentence(_: Request, error: Any) -> Response:
        return PlainTextResponse(f"{error.detail}\n", error.status_code)

    ui.page("/", dependencies=[Depends(room)])(styled)
    for status in (404, 503):  # in the place of NiceGUI's, which are pages, too
        core.app.add_exception_handler(status, sentence)
    ui.run_with(
        app,
        title=title,
        tailwind=False,
        binding_refresh_interval=None,
        reconnect_timeout=5.0,
        message_history_length=50,
        show_welcome_message=False,
    )
    handlers = core.sio.handlers["/"]
    handlers.pop("log", None)  # which writes what a browser says to the terminal
    # Socket.IO learns by a TypeError that NiceGUI's answer to a disconnection takes no reason.
    handlers.update({name: _tolerant(answer) for name, answer in handlers.items() if name != "disconnect"})
    logging.getLogger("nicegui").addFilter(_is_no_event)
    return Packets(app, core.sio.eio)


def _is_no_event(record: logging.LogRecord) -> bool:
    """Whether a record is no failure of an element by the arguments of an event, which are whatever a browser says."""
    error = record.exc_info[1] if record.exc_info else None
    trace = error.__traceback__ if isinstance(error, _NOT_THE_PAGE_S) else None
    return trace is None or trace.tb_frame.f_code.co_name != "handle_event"


def _tolerant(answer: Callable[..., Any]) -> Callable[..., Any]:
    """NiceGUI's answer to a message of a websocket, and none to a message without the entries of the page's own."""

    async def answered(*message: Any) -> Any:
        try:
            made = answer(*message)
            return await made if isawaitable(made) else made
        except _NOT_THE_PAGE_S as error:
            logging.getLogger(__name__).debug("a message is none of the page's: %r", error)
            return False

    return answered


def _server(gate: Gate, ready: Callable[[], None]) -> Any:
    import h11
    import uvicorn

    def is_ours(record: logging.LogRecord) -> bool:
        """Whether a record is no answer that could not be given: a request broke off in disorder, or the page ended."""
        return not (record.exc_info and isinstance(record.exc_info[1], h11.ProtocolError | asyncio.CancelledError))

    class WatchServer(uvicorn.Server):
        """A server that says when it answers, and ends by every signal that stops softcal."""

        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            ready()

        @contextmanager
        def capture_signals(self) -> Generator[None]:
            """End the page as by SIGTERM when its terminal is closed, too, unless that is ignored (nohup)."""
            before = signal.getsignal(signal.SIGHUP) if hasattr(signal, "SIGHUP") else None
            with super().capture_signals():
                if callable(before):
                    signal.signal(signal.SIGHUP, self.handle_exit)
                try:
                    yield
                finally:
                    if callable(before):
                        signal.signal(signal.SIGHUP, before)

    # h11 limits the length of what comes before a body, which the faster httptools takes without end.
    config = uvicorn.Config(gate, http="h11", log_level="error", timeout_graceful_shutdown=1, server_header=False)
    logging.getLogger("uvicorn.error").addFilter(is_ours)  # after the configuration, which sets it anew
    return WatchServer(config)
