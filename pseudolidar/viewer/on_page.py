"""What of a page of viser's can be touched now, and what its browsers owe."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pseudolidar.viewer.inbound import Control

if TYPE_CHECKING:
    from viser import ViserServer

    from pseudolidar.viewer.connection import Connection

# Controls whose values are bytes, though viser does not say so.
COLOURS = ("GuiRgbProps", "GuiRgbaProps")
# Controls whose numbers cannot pass one another.
RISING = ("GuiMultiSliderProps",)
# Folders in folders; a control of this page lies in three at most.
DEEPEST = 16


class OnPage:
    """Looks up what messages name; nothing can be touched before viser is whole."""

    def __init__(self) -> None:
        self.viser: ViserServer | None = None

    def control(self, uuid: str) -> Control | None:
        """The control with that identity; None where there is none, or it is not to be seen."""
        handle = (
            None if self.viser is None else self.viser.gui._gui_input_handle_from_uuid.get(uuid)
        )
        # Bars of progress are among them, and are nothing to be turned.
        if handle is None or getattr(handle, "disabled", True) or not self._is_seen(handle):
            return None
        props: Any = handle._impl.props
        kind = type(props).__name__
        options = getattr(props, "options", None)
        least, most = getattr(props, "min", None), getattr(props, "max", None)
        if kind in COLOURS:
            least, most = 0, 255
        options = None if options is None else tuple(options)
        return Control(handle.value, least, most, options, rising=kind in RISING)

    def _is_seen(self, handle: Any) -> bool:
        """Whether it and all folders that it lies in are shown; whichever tab is in front."""
        assert self.viser is not None
        containers: Any = self.viser.gui._container_handle_from_uuid
        for _ in range(DEEPEST):
            handle = getattr(handle, "_parent", handle)  # of a tab the group of tabs
            if not handle.visible:
                return False
            place = handle._impl.parent_container_id
            if place == "root":
                return True
            handle = containers.get(place)
            if handle is None:
                return False
        return False

    def handle(self, name: str) -> Control | None:
        """The place (3,) of a node that can be dragged; None where there is none of that name."""
        if self.viser is None:
            return None
        found = self.viser.scene._handle_from_transform_controls_name.get(name)
        if found is None or not found.visible:
            return None
        least, most = zip(*found.translation_limits, strict=True)
        return Control(tuple(map(float, found.position)), least, most)

    def pictures_due(self, client: Connection) -> int:
        """How many pictures were asked for that this browser has not sent."""
        from viser._messages import GetRenderResponseMessage

        viser = self.viser
        if viser is None:
            return 0
        server = viser._websock_server
        for number, connection in server._live_connections.items():
            handle = viser._connected_clients.get(number) if connection is client else None
            if handle is not None:
                handlers = handle._websock_connection._incoming_handlers
                return len(handlers.get(GetRenderResponseMessage, ()))
        return 0
