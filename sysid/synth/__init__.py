"""Synthetic logs from a known truth, moved by an integrator of their own."""

from sysid.synth.log import SyntheticLog, SynthOptions, TrueRelease
from sysid.synth.synthesis import synthesise

__all__ = ["SynthOptions", "SyntheticLog", "TrueRelease", "synthesise"]
