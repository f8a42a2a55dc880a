"""The screws of an arm as it was built, from where a tracker saw its tip: first the constants of a report, then a real arm with noise."""

import numpy as np

import pieper
from pieper.kinematics.calibration import calibrate
from pieper.kinematics.screw_parameters import ScrewParameters

rng = np.random.default_rng(1)

# The MH12 report read its screws off a display that was not at zero, and added "drift offsets" to its targets instead.
printed = pieper.load("mh12-report")
public = pieper.load("mh12", nominal=True).lock(joint_4_r=0.0)
q = rng.uniform(public.limits[:, 0], public.limits[:, 1], (40, 5))
theta = q * [1, 1, 1, -1, 1]  # the report turns joint_5_b the other way round
T_seen = public.fk(q) @ np.diag([-1.0, -1.0, 1.0, 1.0])  # and its tool is turned by half a turn
found = calibrate(printed.chain, theta, T_seen)
check = found.check(theta, T_seen)
print(f"printed constants: {1e3 * check.position_before.mean():.3f} mm off in the mean")
print(f"after the fit:     {check.position_error.max():.0e} m off at most, no offsets needed")
print("axis of joint_3_u goes through", np.cross(*found.chain.screws[2].reshape(2, 3)[::-1]).round(6) + 0.0, "m")

# An arm on the floor: everything half a millimetre and half a milliradian off, positions seen with 0.05 mm of noise, one of them wrong.
ur5e = pieper.load("ur5e")
paper = ScrewParameters.of(ur5e.chain, ["screws", "home"])
built = pieper.load(paper.moved(rng.normal(0.0, 5e-4, len(paper.parameters))).chain())
q = rng.uniform(-2.0, 2.0, (70, 6))
p_seen = built.fk(q)[:, :3, 3] + rng.normal(0.0, 5e-5, (70, 3))
p_seen[7, 2] += 0.01
found = calibrate(ur5e.chain, q[:50], p_seen[:50], position_sigma=5e-5)
check = found.check(q[50:], p_seen[50:])
print()
print(f"{found}; left out: measurement {found.left_out.tolist()}")
print(f"chi-square {found.chi_square:.0f} for {found.degrees_of_freedom} degrees of freedom")
print(
    f"20 other positions: {1e3 * check.position_before.mean():.2f} mm off before, {1e3 * check.position_error.mean():.2f} mm after"
)
for words in found.identifiability.unseen:
    print(f"not seen: {words}")
calibrated = pieper.load(found.chain)
print(f"it is solved like any arm: {calibrated.ik_info.structure}")
