"""One arm in every format: URDF numbers, screws, DH rows; and what happens when axes are nearly parallel."""

import numpy as np

from pieper.model import catalog
from pieper.model.dh import CONVENTIONS, as_dh, forward_kinematics, from_dh
from pieper.model.poe import as_screws, from_screws, revolute

chain = catalog.describe("mh12", nominal=True).chain()
screws, home = as_screws(chain)
print("Yaskawa MH12, screws at the home pose: linear part [m], angular part [-]")
for name, screw in zip(chain.joint_names, screws, strict=True):
    print(f"  {name:10} {screw.round(3) + 0.0}")

print()
print(as_dh(chain))

print("\nThere and back, largest difference of screws [m, -] and home pose [m, -]")
for convention in CONVENTIONS:
    back = from_dh(as_dh(chain, convention=convention))
    differences = np.abs(back.screws - chain.screws).max(), np.abs(back.home - chain.home).max()
    print(f"  {convention:9} {differences[0]:.0e}  {differences[1]:.0e}")

# The youBot: a table on record, checked against the joint origins of its URDF.
table, youbot = catalog.dh_tables("youbot")["full"], catalog.describe("youbot").chain()
difference = np.abs(from_dh(table).screws - youbot.screws).max()
upright = np.radians([170.0, 65.0, -146.0, 102.5, 167.5])
print(f"\nKUKA youBot, table on record against its URDF: {difference:.0e} m")
print(f"  upright, the end of the arm is at {forward_kinematics(table, upright)[:3, 3].round(6) + 0.0} m")

# Two axes 0.4 m apart and almost parallel: the common normal runs away, Hayati's rows do not mind.
print(
    "\nTilt between axes [rad]   d along the common normal [m]   beta of the Hayati row [rad]   error there and back [m]"
)
tip = np.eye(4)
tip[:3, 3] = [0.7, 0.1, 0.2]
for tilt in (1e-1, 1e-3, 1e-6, 1e-9):
    axes = [[0.0, 0.0, 1.0], [np.sin(tilt), 0.0, np.cos(tilt)]]
    arm = from_screws(revolute(axes, [[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]]), tip)
    hayati = as_dh(arm, convention="hayati")
    error = np.abs(from_dh(hayati).screws - arm.screws).max()
    print(f"  {tilt:22.0e} {-0.4 / np.tan(tilt):31.3g} {hayati.rows[0].beta:30.3g} {error:26.0e}")
