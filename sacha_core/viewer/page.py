"""The page in the browser: the avatar, its timeline, and what a hand can change."""

from __future__ import annotations

import io
import logging
import threading
import time
from contextlib import redirect_stdout
from typing import Any

import numpy as np
import viser
from jaxtyping import Float

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import OptionError, SachaError
from sacha_core.viewer.grades import Grades
from sacha_core.viewer.puppet import Gesture, Puppet

__all__ = ["Page"]

AS_IT_LOOKS, BY_REGION = "as it looks", "by region"
COMPONENTS = 10  # of a head whose expressions have no names: the first ones move most
SPREAD = 3.0  # standard deviations that a slider reaches
TURNS = {  # slider: joint, axis, least and most, radians
    "jaw": ("jaw", 0, -0.1, 0.5),
    "nod": ("neck", 0, -0.5, 0.5),
    "turn": ("neck", 1, -0.7, 0.7),
    "look up": ("both eyes", 0, -0.4, 0.4),
    "look aside": ("both eyes", 1, -0.6, 0.6),
}
JOINTS_OF = {"jaw": 3, "neck": 2, "both eyes": 5}  # joints that a head must have for a slider to move anything
DISTANCE_M = 0.9


class Page:
    """Serves an avatar to browsers until it is closed.

    Args:
        title: shown on top.
        puppet: that is posed.
        grades: what it looks like by level.
        region_colours: (f, 3) sRGB in [0, 1] of each triangle's region; None where regions are not known.
        host: address to listen at.
        port: to listen at; another one is taken where it is in use.

    Raises:
        OptionError: nobody may listen there.
    """

    def __init__(
        self,
        title: str,
        puppet: Puppet,
        grades: Grades,
        region_colours: Float[np.ndarray, "f 3"] | None,
        host: str,
        port: int,
    ) -> None:
        self._puppet, self._grades, self._region_colours = puppet, grades, region_colours
        self._changed, self._closed = threading.Event(), threading.Event()
        self._sending = threading.RLock()  # nothing is sent once the server has stopped
        # Browsers open connections ahead and drop them again, which the library tells with a traceback
        logging.getLogger("websockets").setLevel(logging.CRITICAL)
        try:
            with redirect_stdout(io.StringIO()):  # it greets; where we listen is ours to say
                self._server = viser.ViserServer(host=host, port=port, label=f"SACHA: {title}", verbose=False)
        except OSError as error:
            raise OptionError(f"cannot listen at {host}:{port}: {error}; expected another --port or --host") from error
        self._eye = self._place_camera()
        self._splats: Any = None
        self._timeline: Any
        self._build(title)
        self._server.on_client_connect(self._welcome)

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._server.get_port())

    @property
    def server(self) -> viser.ViserServer:
        """The server, whose clients can be asked for pictures."""
        return self._server

    def run(self) -> None:
        """Show frame after frame, and what is changed by hand, until `close`."""
        self._changed.set()
        next_s = time.monotonic()
        while not self._closed.is_set():
            if self._playing.value:
                next_s = max(next_s + 1 / self._puppet.motion.frame_rate, time.monotonic())
                self._closed.wait(max(next_s - time.monotonic(), 0))
                self._send(advance=True)
            elif self._changed.wait(0.1):
                self._send()
            else:
                next_s = time.monotonic()

    def close(self) -> None:
        """End `run` and stop listening."""
        self._closed.set()
        with self._sending, redirect_stdout(io.StringIO()):
            self._server.stop()

    def _send(self, advance: bool = False) -> None:
        """Show the present state, or the frame after it, unless the page was closed meanwhile."""
        with self._sending:
            if self._closed.is_set():
                return
            if advance:
                self._timeline.value = (self._timeline.value + 1) % len(self._puppet)
            self._changed.clear()
            self._show()

    def set(self, **values: Any) -> None:
        """Move controls as a hand would: `frame`, `level`, `colours`, `playing`, or a slider by its name."""
        controls = {"frame": self._timeline, "level": self._level, "colours": self._colouring, "playing": self._playing}
        for name, value in values.items():
            (controls | self._sliders)[name].value = value
        self._changed.set()

    def _build(self, title: str) -> None:
        gui, touched = self._server.gui, lambda _: self._changed.set()
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        self._facts = gui.add_markdown(f"**{title}**")
        last = len(self._puppet) - 1
        self._timeline = gui.add_slider("frame", 0, max(last, 1), 1, 0, disabled=last < 1)
        self._playing = gui.add_checkbox("play", initial_value=False, disabled=last < 1)
        self._level = gui.add_dropdown("level", self._grades.names)
        choices = (AS_IT_LOOKS,) if self._region_colours is None else (AS_IT_LOOKS, BY_REGION)
        self._colouring = gui.add_dropdown("colours", choices)
        self._sliders: dict[str, Any] = {}
        with gui.add_folder("Pose"):
            for name, (joint, _, least, most) in TURNS.items():
                if len(self._puppet.head.parents) >= JOINTS_OF[joint]:
                    self._sliders[name] = gui.add_slider(name, least, most, 0.01, 0.0)
        names = self._puppet.head.expression_names
        shown = names or tuple(f"expression {k}" for k in range(min(COMPONENTS, self._puppet.head.exprdirs.shape[2])))
        with gui.add_folder("Expression", expand_by_default=not names):
            for name in shown:
                least = 0.0 if names else -SPREAD
                self._sliders[name] = gui.add_slider(name, least, 1.0 if names else SPREAD, 0.01, 0.0)
        self._components = {name: k for k, name in enumerate(shown)}
        reset = gui.add_button("Reset")
        for control in (self._timeline, self._playing, self._level, self._colouring, *self._sliders.values()):
            control.on_update(touched)
        reset.on_click(lambda _: self.set(**dict.fromkeys(self._sliders, 0.0)))

    def _place_camera(self) -> Float[np.ndarray, "3"]:
        """Look at the head from the front."""
        origin = self._puppet.head.v_template.mean(axis=0) + self._puppet.motion.translation[0]
        eye: np.ndarray = origin + np.array([0.0, 0.0, DISTANCE_M], np.float32)
        self._server.scene.set_up_direction("+y")
        self._server.initial_camera.position = tuple(eye.tolist())
        self._server.initial_camera.look_at = tuple(origin.tolist())
        self._server.initial_camera.fov = 0.5
        return eye.astype(np.float32)

    def _welcome(self, client: viser.ClientHandle) -> None:
        """Colour the avatar as it looks from where a browser's camera stands."""

        @client.camera.on_update
        def _(camera: viser.CameraHandle) -> None:
            self._eye = np.array(camera.position, np.float32)
            self._changed.set()

    def _gesture(self) -> Gesture:
        expression = {k: self._sliders[name].value for name, k in self._components.items() if self._sliders[name].value}
        turns: dict[str, tuple[float, float, float]] = {}
        for name, (joint, axis, _, _) in TURNS.items():
            amount = self._sliders[name].value if name in self._sliders else 0.0
            for one in ("left_eye", "right_eye") if joint == "both eyes" else (joint,):
                turn = list(turns.get(one, (0.0, 0.0, 0.0)))
                turn[axis] += amount
                turns[one] = (turn[0], turn[1], turn[2])
        return Gesture(expression, turns)

    def _show(self) -> None:
        """Pose and send; what cannot be posed or encoded is said on the page, and the picture stays."""
        try:
            gaussians, n_bytes = self._grades[self._level.value]
            colours = self._colours(gaussians)
            frame = min(int(self._timeline.value), len(self._puppet) - 1)
            splats = self._puppet.splats(gaussians, frame, self._gesture(), self._eye, colours)
        except SachaError as error:
            self._facts.content = f"**{error}**"
            return
        size = "" if n_bytes is None else f", {n_bytes / 1000:,.1f} KB"
        facts = f"**{len(gaussians):,} Gaussians**{size}"
        if self._facts.content != facts:
            self._facts.content = facts
        arrays = (splats.means, splats.covariances, splats.colours, splats.opacities)
        if self._splats is None:
            self._splats = self._server.scene.add_gaussian_splats("/avatar", *arrays)
        else:
            self._splats.set_gaussians(*arrays)

    def _colours(self, gaussians: Gaussians) -> Float[np.ndarray, "n 3"] | None:
        if self._region_colours is None or self._colouring.value != BY_REGION:
            return None
        of: np.ndarray = self._region_colours[gaussians.binding]
        return of
