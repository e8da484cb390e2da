"""`husky-sysid loaded`: the spring under load, from decays with weights on the deck."""

from typing import Annotated, Any

from cyclopts import Parameter

from sysid.cli.console import BoardName, Common, Printer
from sysid.cli.parameter_options import parse_or_read
from sysid.errors import SysidError
from sysid.quantity import parse_quantity


def loaded(
    *,
    board: BoardName,
    reading: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    rider: float = 33.3,
    common: Common = Common(),
) -> int:
    """Measure the tilt spring under load, from decays of the deck with known weights on it.

    The stiffness of a bushing may change under a rider. Fix weights on the deck, let it decay under each, and once bare.

    Args:
        board: The board; its roll inertia is used.
        reading: MASS,HEIGHT,OMEGA[,OWN] of one decay; may be repeated. Mass of the weight [kg]. Height of its centre above
            the tilt axis [m]. ω_n [rad/s] or the JSON of `decay`. Its own roll inertia [kg*m^2], 0 if left out.
            Quantities as 2.5±0.01, or with a unit as 10cm; '0,0,bare.json' is the bare deck.
        rider: Mass of the rider for the resulting stiffness [kg].
    """
    from sysid.experiments.loaded_decays import GRAVITY, LoadedDecay, loaded_stiffness

    printer = Printer(common)
    record = common.space.load_board(board)
    if not rider > 0:
        raise SysidError(f"--rider {rider:g}: must be more than 0 kg.")
    readings: list[LoadedDecay] = []
    for text in reading:
        fields = text.split(",")
        if len(fields) not in (3, 4):
            raise SysidError(f"--reading {text}: expected MASS,HEIGHT,OMEGA[,OWN], with commas between.")
        mass, height, own = (
            parse_quantity(field, unit, f"--reading {text}", positive=False)
            for field, unit in zip((*fields[:2], *fields[3:], "0")[:3], ("kg", "m", "kg*m^2"), strict=True)
        )
        if min(mass.value, height.value, own.value) < 0:
            raise SysidError(f"--reading {text}: mass, height and inertia must not be negative.")
        omega = parse_or_read(fields[2], "omega_n", "rad/s", f"--reading {text}")
        readings.append(LoadedDecay(mass=mass, height=height, own=own, natural_frequency=omega))
    found = loaded_stiffness(readings, record.inertia)
    ridden = found.under(rider * GRAVITY.value)
    rows = [(f"k under {r.mass.value:g} kg", k) for r, k in zip(readings, found.stiffness, strict=True)]
    rows += [
        ("k of the bare deck, by the line", found.bare),
        ("k that a newton adds", found.per_newton),
        (f"k under {rider:g} kg", ridden),
    ]
    printer.quantities(rows, f"{record.name}: the spring under load")
    low, high = found.per_newton.ci95
    if low <= 0 <= high:
        printer.say("the load does not change the spring significantly")
    if rider > 1.5 * max(r.mass.value for r in readings):
        printer.warn(f"{rider:g} kg is far more than the weights tried; the line is extrapolated.")
    content: dict[str, Any] = {
        "stiffness": [k.to_json() for k in found.stiffness],
        "bare": found.bare.to_json(),
        "per_newton": found.per_newton.to_json(),
        "rider_kg": rider,
        "under_rider": ridden.to_json(),
        "chi_square": found.chi_square,
        "degrees_of_freedom": found.degrees_of_freedom,
    }
    printer.result(content)
    return 0
