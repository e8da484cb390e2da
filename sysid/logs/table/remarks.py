"""Notes and warnings of reading a log: inferences and faults."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Remarks:
    """Sentences for people, in the order in which they came up; `+` joins them."""

    notes: tuple[str, ...] = ()
    """What was inferred."""
    warnings: tuple[str, ...] = ()
    """Faults, certain or possible."""

    def __add__(self, other: "Remarks") -> "Remarks":
        """Return these and then the others."""
        return Remarks(self.notes + other.notes, self.warnings + other.warnings)


def note(about: str, text: str) -> Remarks:
    """Return one note; its subject is one word before the colon."""
    return Remarks(notes=(f"{about}: {text}",))


def warning(text: str) -> Remarks:
    """Return one warning."""
    return Remarks(warnings=(text,))


def about_and_text(note: str) -> tuple[str, str]:
    """Return what a note is about, '' where it does not say so, and the rest of it."""
    about, colon, text = note.partition(": ")
    return (about, text) if colon and " " not in about else ("", note)
