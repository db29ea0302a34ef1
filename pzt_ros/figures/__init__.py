"""The thesis' figures, drawn again from the models of this library and judged against the thesis' words."""
