"""Check boxes that show and hide, and the legend that says what the colours mean."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bsp_informed_planner.visualization.palette import Colour
from bsp_informed_planner.visualization.viewer.server import Viewer, rgb

if TYPE_CHECKING:
    import viser


@dataclass(frozen=True)
class LegendEntry:
    """What a colour stands for.

    Attributes:
        colour: of the thing.
        text: its name, and what it is.
        shape: "area", "line" or "dot".
    """

    colour: Colour
    text: str
    shape: str = "area"

    def as_html(self) -> str:
        red, green, blue = rgb(self.colour)
        height = "3px" if self.shape == "line" else "12px"
        radius = "50%" if self.shape == "dot" else "2px"
        width = "12px" if self.shape == "dot" else "20px"
        swatch = (
            f'<span style="display:inline-block;width:{width};height:{height};border-radius:{radius};'
            f'background:rgb({red},{green},{blue})"></span>'
        )
        return (
            '<div style="display:flex;align-items:center;margin:0 0 5px 0">'
            f'<span style="flex:0 0 30px;display:flex;align-items:center">{swatch}</span>'
            f'<span style="font-size:0.85em;line-height:1.25">{html.escape(self.text)}</span></div>'
        )


def add_legend(viewer: Viewer, entries: list[LegendEntry]) -> viser.GuiHtmlHandle:
    """Puts a legend into the panel."""
    return viewer.server.gui.add_html(
        '<div style="padding:4px 14px 6px 14px">' + "".join(entry.as_html() for entry in entries) + "</div>"
    )


class Switch:
    """A check box and the nodes of the scene that it shows and hides.

    Attributes:
        box: the check box.
    """

    def __init__(self, viewer: Viewer, label: str, *, on: bool = True, hint: str = "") -> None:
        self._viewer = viewer
        self._nodes: list[Any] = []
        self._make: Callable[[], list[Any]] | None = None
        self._is_hidden = False
        self.box = viewer.server.gui.add_checkbox(label, on, hint=hint or None)
        self.box.on_update(lambda _: self._apply())

    @property
    def is_on(self) -> bool:
        return self.box.value

    @property
    def nodes(self) -> list[Any]:
        """The nodes of the scene, as handles of viser."""
        return list(self._nodes)

    def replace(self, nodes: list[Any]) -> None:
        """Takes other nodes for those that it had, which are removed from the scene."""
        with self._viewer.lock:
            names = {node.name for node in nodes}
            for node in self._nodes:
                # A node that has been added anew under the same name has replaced this one.
                if node.name not in names:
                    node.remove()
            self._nodes = list(nodes)
            self._make = None
            self._apply()

    def replace_when_on(self, make: Callable[[], list[Any]]) -> None:
        """The same, with nodes that are large and only made once they are to be seen."""
        with self._viewer.lock:
            self.replace([])
            self._make = make
            self._apply()

    def hide(self, hidden: bool) -> None:
        """Hides the nodes for now, whatever the box says, or not any more."""
        self._is_hidden = hidden
        self._apply()

    def _apply(self) -> None:
        with self._viewer.lock:
            if self._make is not None and self.is_on:
                self.replace(self._make())
                return
            for node in self._nodes:
                node.visible = self.is_on and not self._is_hidden
