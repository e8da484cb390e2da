"""What reading a log has to say: what was inferred, and what is wrong."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Remarks:
    """Sentences for people, in the order in which they came up; `+` joins them."""

    notes: tuple[str, ...] = ()
    """What was inferred."""
    warnings: tuple[str, ...] = ()
    """What is wrong, or may be."""

    def __add__(self, other: "Remarks") -> "Remarks":
        """Return these and then the others."""
        return Remarks(self.notes + other.notes, self.warnings + other.warnings)


def note(text: str) -> Remarks:
    """Return one note."""
    return Remarks(notes=(text,))


def warning(text: str) -> Remarks:
    """Return one warning."""
    return Remarks(warnings=(text,))
