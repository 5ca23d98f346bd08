"""The room of diagnoses: a model, its verdict on a recording, and the evidence for it."""

import secrets
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fastapi import Body, Depends, FastAPI, HTTPException, Request
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.middleware import Middleware
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.staticfiles import StaticFiles

from swashtwin.explorer.figures import Figures
from swashtwin.explorer.twins import TwinRoom
from swashtwin.explorer.workspace import FACTS, Name, Workspace
from swashtwin.foundation import VERSION, InputError, SwashTwinError, json_text, plural, to_table
from swashtwin.monitoring import Access, Guard, PageSettings, serving_page
from swashtwin.pump import is_healthy
from swashtwin.recordings import FactChange

if TYPE_CHECKING:
    from swashtwin.diagnosis import AnomalyDetector, Diagnosis, FaultClassifier, PriorClassifier
    from swashtwin.recordings import Recording


PRIOR = "25scy14-1b"
"""Design whose prior is shipped."""
Content = Annotated[bytes, Body(media_type="application/octet-stream")]
_KEPT = 64


class Diagnoses:
    """Verdicts of one model on the recordings of a workspace.

    Parameters
    ----------
    model : file of the model; None until one is dropped on the page. A prior is adapted to the
        healthy recordings.
    """

    def __init__(self, workspace: Workspace, model: Path | None) -> None:
        self._workspace = workspace
        self._answers: OrderedDict[tuple[str, str], dict[str, Any]] = OrderedDict()
        self._model: FaultClassifier | AnomalyDetector | PriorClassifier | None = None
        self.name = ""
        if model is not None:
            self._take(model, model.name)

    def _take(self, path: Path, name: str) -> None:
        from swashtwin.diagnosis import PriorClassifier, load_model

        model = load_model(path)
        if isinstance(model, PriorClassifier) and not model.specimen:
            rows = [
                row.recording
                for row in self._workspace.rows.values()
                if row.state == "ready" and row.recording
            ]
            healthy = [
                recording for recording in rows if recording.label and is_healthy(recording.label)
            ]
            model, name = (
                model.fit(healthy),
                f"{name}, adapted to {plural(len(healthy), 'healthy recording')} here",
            )
        self._model, self.name = model, name
        self._answers.clear()

    def model(self) -> dict[str, Any]:
        """The model's name."""
        return {"model": self.name}

    def take_prior(self) -> dict[str, Any]:
        """Take the shipped pump prior, adapted to the healthy recordings."""
        self._take(Path(PRIOR), f"the prior of {PRIOR}")
        return self.model()

    def drop(self, content: Content, name: Name) -> dict[str, Any]:
        """Take a model that was dropped on the page; it is kept in memory only.

        Raises
        ------
        ArtifactError
            It is no model, or a damaged one.
        """
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "model.safetensors"
            path.write_bytes(content)
            try:
                self._take(path, name)
            except SwashTwinError as cause:
                raise type(cause)(str(cause).replace(str(path), name)) from None
        return self.model()

    def diagnosis(self, name: Name) -> dict[str, Any]:
        """Verdict on a recording, how sure it is, and its evidence."""
        from swashtwin.diagnosis import next_checks

        if self._model is None:
            raise InputError(
                "there is no model yet; drop one on the page, or start with --model MODEL."
            )
        recording = self._workspace.recording(name)
        key = name, repr(self._workspace.rows[name].stated)
        if key not in self._answers:
            verdict = self._model.diagnose(recording)
            labels = verdict.prediction_set[:2] or filter(None, [verdict.label])
            checks = next_checks(*labels, unknown=verdict.unknown)
            self._answers[key] = {
                **verdict.to_dict(), "sentence": verdict.sentence(), "checks": to_table(checks),
                "spectrum": "" if verdict.spectrum is None else verdict.spectrum.sentence(),
                **self._evidence(recording, verdict),
            }  # fmt: skip
            while len(self._answers) > _KEPT:
                self._answers.popitem(last=False)
        return {"model": self.name, **self._answers[key]}

    def _evidence(self, recording: "Recording", verdict: "Diagnosis") -> dict[str, Any]:
        """Bands [Hz] that speak for the verdict, and the nearest recordings of the training."""
        from swashtwin.diagnosis import FaultClassifier, explain

        found: dict[str, Any] = {
            "bands": [],
            "nearest": [],
            "evidence": [item.sentence for item in verdict.changes],
        }
        if verdict.label is None or not isinstance(self._model, FaultClassifier):
            return found
        fitted = self._model.fitted_
        if not fitted.network.has_gradients or len(verdict.probabilities) < 2:
            return found
        evidence = explain(fitted, recording, verdict)
        rows = [row for row in self._workspace.rows.values() if row.recording is not None]
        names = {row.recording.recording_id: row.name for row in rows if row.recording is not None}
        found["evidence"] = evidence.sentences()
        found["nearest"] = [
            {**to_table(item), "name": names.get(item.recording_id)} for item in evidence.nearest
        ]
        found["bands"] = [
            {
                "channel": channel,
                "words": evidence.describe(band),
                "low": band.low,
                "high": band.high,
            }
            for channel, band, _ in evidence.strongest(8)
            if band.part == "signal"
        ]
        return found


LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")
TOKEN = "x-explorer"
"""Header with the page's token, without which nothing is changed."""
_UPLOADS = frozenset({"/api/facts", "/api/drop"})


def build_explorer(workspace: Workspace, model: Path | None = None) -> FastAPI:
    """The explorer of a workspace, to be served on this computer only; with a model to diagnose
    with, or without.
    """
    token = secrets.token_urlsafe(32)
    guard = Middleware(Guard, hosts=LOCAL_NAMES, access=Access(PageSettings()), uploads=_UPLOADS)
    application = FastAPI(
        title="swashtwin explore", version=VERSION, openapi_url=None, middleware=[guard]
    )

    def require_token(request: Request) -> None:
        if not secrets.compare_digest(request.headers.get(TOKEN, "").encode(), token.encode()):
            raise HTTPException(403, "The page is too old. Load it again.")

    environment = Environment(
        loader=PackageLoader("swashtwin.explorer"), autoescape=True, undefined=StrictUndefined
    )
    html = environment.get_template("explorer.html.jinja").render(version=VERSION, token=token)

    @application.get("/", response_class=HTMLResponse)
    def page() -> str:
        return html

    @application.exception_handler(SwashTwinError)
    async def refuse(request: Request, error: SwashTwinError) -> Response:
        return JSONResponse({"detail": str(error)}, 422)

    @application.exception_handler(OSError)
    async def report_disk(request: Request, error: OSError) -> Response:
        return JSONResponse(
            {"detail": f"{error.filename or 'a file'}: {error.strerror or error}"}, 422
        )

    def propose(
        given: dict[str, str],
    ) -> dict[str, Any]:  # what nobody but the user can say of a folder's files
        workspace.propose({key: text.strip() for key, text in given.items()})
        return workspace.table()

    def change(changes: list[FactChange], undo: Annotated[bool, Body()] = False) -> dict[str, Any]:
        workspace.change([_understood(each) for each in changes], undo=undo)
        return workspace.table()

    figures, twins, models = Figures(workspace), TwinRoom(workspace), Diagnoses(workspace, model)
    reading: dict[str, Callable[..., Any]] = {
        "rows": workspace.table, "samples": figures.samples, "spectrum": figures.spectrum, "levels": figures.levels,
        "waterfall": figures.waterfall, "speed": figures.speed, "comparison": figures.comparison,
        "twin_starts": twins.starts, "twin_cutaway": twins.cutaway, "twin_job": twins.progress,
        "model": models.model, "diagnosis": models.diagnosis,
    }  # fmt: skip
    changing: dict[str, Callable[..., Any]] = {
        "answers": propose, "facts": change, "twin_lines": twins.lines, "twin_save": twins.save,
        "twin_calibrate": twins.calibrate, "twin_stop": twins.stop, "twin_windows": twins.add_windows,
        "twin_pump": twins.add_pump, "prior": models.take_prior, "drop": models.drop,
    }  # fmt: skip
    for name, work in reading.items():
        application.get(f"/api/{name}")(_answering(work))
    for name, work in changing.items():
        application.post(f"/api/{name}", dependencies=[Depends(require_token)])(_answering(work))
    packages: list[str | tuple[str, str]] = [
        (__package__, "static"),
        ("swashtwin.monitoring.page", "static"),
    ]
    application.mount("/static", StaticFiles(packages=packages))
    return application


def _answering(work: Callable[..., Any]) -> Callable[..., Response]:
    """`work` with its table as JSON, where what is no finite number is null."""

    @wraps(work)
    def answer(*values: Any, **named: Any) -> Response:
        content = work(*values, **named)
        if isinstance(content, Response):
            return content
        return Response(json_text(to_table(content)), media_type="application/json")

    return answer


def _understood(change: FactChange) -> FactChange:
    """A change as the index writes it, of what somebody typed."""
    if change.fact not in FACTS:
        raise InputError(f"{change.fact[:100]!r} is no fact that is edited here.")
    after: Any = str(change.after or "").strip() or None
    if change.fact == "sensitivity" and after and "," in after:
        after = [part.strip() for part in after.split(",")]
    return replace(change, after=after)


def run_explorer(
    source: Path,
    *,
    model: Path | None = None,
    port: int,
    stop: threading.Event,
    started: Callable[[str], None],
) -> None:
    """Serve the explorer of `source` on this computer until `stop` is set.

    Raises
    ------
    DataError
        There is nothing to look at.
    InputError
        Another program uses the port.
    """
    with serving_page(build_explorer(Workspace(source), model), "127.0.0.1", port):
        started(f"http://127.0.0.1:{port}/")
        stop.wait()
