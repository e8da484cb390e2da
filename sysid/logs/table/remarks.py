"""Notes and warnings of reading a log: what was inferred, and what is wrong."""

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


def note(about: str, text: str) -> Remarks:
    """Return one note; what it is about is one word, which stands before the colon."""
    return Remarks(notes=(f"{about}: {text}",))


def warning(text: str) -> Remarks:
    """Return one warning."""
    return Remarks(warnings=(text,))


def about_and_text(note: str) -> tuple[str, str]:
    """Return what a note is about, '' where it does not say so, and the rest of it."""
    about, colon, text = note.partition(": ")
    return (about, text) if colon and " " not in about else ("", note)
