"""One rotation in every form, gimbal lock in numbers, and two ways from one pose to another."""

import numpy as np

from pieper.spatial import pose, rotation, twist

# A quaternion from a sensor, xyzw, not quite of unit length: it is normalised.
R = rotation.from_quaternion([0.2, -0.4, 0.6, 1.6])
axis, theta = rotation.as_axis_angle(R)
print("One rotation")
print(f"  quaternion xyzw [-]        {rotation.as_quaternion(R).round(4)}")
print(f"  rotation vector [rad]      {rotation.as_rotation_vector(R).round(4)}")
print(f"  axis [-] and angle [deg]   {axis.round(4)}  {np.rad2deg(theta):.3f}")
print(f"  Gibbs vector [-]           {rotation.as_gibbs(R).round(4)}")
print(f"  roll, pitch, yaw [deg]     {np.rad2deg(rotation.as_rpy(R)).round(3)}")
print(f"  Euler angles YZY [deg]     {np.rad2deg(rotation.as_euler('YZY', R)).round(3)}")

# At a pitch of 90 degrees roll and yaw turn about the same axis.
locked = rotation.from_rpy(np.deg2rad([40.0, 90.0, 10.0]))
report = rotation.gimbal_lock("ZYX", locked)
print("\nGimbal lock, ZYX at roll 40, pitch 90, yaw 10 deg")
print(f"  locked: {report.locked}; determined: the {report.determined} yaw - roll = {np.rad2deg(report.value):.3f} deg")
for turn in np.deg2rad([0.0, 10.0, 70.0]):
    angles = report.alternatives(turn)
    error = np.abs(rotation.from_euler("ZYX", angles) - locked).max()
    print(f"  yaw, pitch, roll {np.rad2deg(angles).round(3)} deg gives the same matrix to {error:.0e}")
print(f"  the same rotation, {rotation.gimbal_lock('ZYZ', locked)}")

# From one pose to another: along a screw, or straight.
T_start = pose.from_xyz_rpy([0.4, 0.0, 0.3], [0.0, 0.0, 0.0])
T_end = pose.from_xyz_rpy([0.0, 0.4, 0.5], np.deg2rad([0.0, 0.0, 90.0]))
metres, radians = pose.distance(T_start, T_end)
print(f"\nTwo poses, {metres:.3f} m and {np.rad2deg(radians):.1f} deg apart")
print(f"  twist between them, linear [m] and angular [rad]: {twist.log(pose.inverse(T_start) @ T_end).round(3) + 0.0}")
for motion in ("screw", "straight"):
    halfway = pose.interpolate(T_start, T_end, fraction=0.5, motion=motion)
    print(f"  halfway, {motion:8}: position {pose.position(halfway).round(4)} m")
