"""Pages of black shapes and text, to scale, as files that printers take."""
