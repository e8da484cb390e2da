"""From arrays to a corrected MJCF: swing.csv holds time [s] and angle [rad] of the knee of robot.xml, let go three times."""

import numpy as np

import sysid

time, angle = np.loadtxt("swing.csv", delimiter=",", skiprows=1, unpack=True)
log = sysid.Recording.from_arrays(time, angle=angle, unit="rad")
joint = sysid.Joint.from_mjcf("robot.xml", "knee")
print("the model as it is:", sysid.compare(log, joint).status)
found = sysid.diagnose(log, joint)
print("missing:", *found.effects)
fit = sysid.fit(log, joint, found.effects)
print(fit)
(path,) = sysid.Joint.of(fit.board).to_mjcf("robot_fitted.xml")
verdict = sysid.Joint.from_mjcf(path, "knee").check(log)
print(path, "moves as measured" if verdict.passed else verdict.refusal())
