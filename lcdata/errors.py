"""Every error that lcdata raises on purpose.

One root, so that a caller catches `LcdataError` and the command line prints one line. Each
error states the value that was wrong and the remedy.
"""

from __future__ import annotations


class LcdataError(Exception):
    """Root of all errors of this package.

    Args:
        message: What is wrong, with the file, key or topic and the offending value.
        remedy: What the user can do about it.
    """

    def __init__(self, message: str, remedy: str = "") -> None:
        super().__init__(message, remedy)
        self.message = message
        self.remedy = remedy

    def __str__(self) -> str:
        return f"{self.message}: {self.remedy}" if self.remedy else self.message


class GeometryError(LcdataError):
    """A matrix, quaternion or camera that is not what it claims to be."""


class ArmError(LcdataError):
    """An arm model, joint name or joint position that cannot be used."""


class RigError(LcdataError):
    """A rig file with a wrong key or value."""


class RecordingError(LcdataError):
    """A recording that cannot be read."""


class TopicError(RecordingError):
    """A topic that is missing, ambiguous or of an unusable type."""


class MessageError(RecordingError):
    """A message whose content cannot be used: encoding, field layout, size."""


class IntegrationError(RecordingError):
    """Scans that cannot be brought together into one cloud."""


class SourceError(LcdataError):
    """Published data that is not what its format says, or not all there."""


class DatasetError(LcdataError):
    """A data set that is missing, damaged, of another version or in the way."""


class CalibrationError(LcdataError):
    """A method that is unknown, or pairs that it cannot work on."""


class GroundTruthError(LcdataError):
    """Poses, estimates or readings that do not determine what was asked of them."""


class MotionError(GroundTruthError):
    """Images that show another motion than that of the arm's joints."""


class SimulationError(LcdataError):
    """A simulation that cannot be made as asked."""


class ExperimentError(LcdataError):
    """An experiment file with a wrong key or value, or a store that cannot be used."""


class ReportError(LcdataError):
    """Results that cannot be shown."""


class MissingLibraryError(LcdataError):
    """A library that is not installed, or whose system libraries are missing."""
