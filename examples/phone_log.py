"""The decay of a board that carried a phone: stiffness, damping, and how sure they are.

Any phyphox or Sensor Logger export goes in as it comes out of the phone. Call it phone.zip, beside this script.
"""

import sysid

log = sysid.Recording.read("phone.zip")
for note in (*log.notes, *log.warnings):
    print(note)

decay = sysid.fit_decay(log, board=sysid.Board.load("pink"))
print(decay.report())
for warning in decay.warnings:
    print("warning:", warning)

k, d = decay.numbers.stiffness, decay.numbers.damping
print(f"k = {k}, d = {d}, the period is {1e3 * decay.numbers.period.value:.0f} ms")
