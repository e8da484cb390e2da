"""Free decay: logarithmic decrement, damping ratio, frequencies, stiffness and damping."""

from sysid.decay_numbers import DecayNumbers as DecayNumbers
from sysid.decay_numbers import decay_from_peaks as decay_from_peaks
