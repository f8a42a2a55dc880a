"""See and reach: a camera in the cell is calibrated with a board in the hand; then it says where a can is, and the arm picks it up."""

import numpy as np

from pieper.errors import MissingExtraError, MissingLibraryError
from pieper.spatial import pose
from pieper.tasks import see

try:
    task = see.see_task("ur10e")  # or kr210
    calibration = see.calibrate_cell(task, seed=1)  # the hand shows a board to the camera
    colors = see.learn_cans(task, seed=1)  # from boxes on six pictures
except (MissingExtraError, MissingLibraryError) as reason:
    print(f"not simulated: {reason}")
else:
    position, turn = pose.distance(calibration.T_base_camera(), task.scene_camera.T_world_camera)
    print(
        f"camera at {calibration.T_base_camera()[:3, 3].round(4)} m, from {calibration.used.sum()} views of {task.board}"
    )
    print(f"  residual {calibration.pixel_rms:.3f} px, +- {1e3 * calibration.position_deviation.max():.2f} mm")
    print(f"  off the truth by {1e3 * position:.2f} mm and {np.degrees(turn):.4f} deg")

    with see.SeeAndPick(task, seed=1, calibration=calibration, colors=colors) as run:
        for cycle in run.run(1):  # the cans lie anywhere on the table, in a light of their own
            look = run.looks[-1]
            if look.found is not None:
                print(f"{look.name} seen at {look.found.p_base[:2].round(4)} m, off by {1e3 * look.error:.2f} mm")
                print(f"  its outline agrees by {look.found.agreement:.0%}; light from {look.light.direction.round(2)}")
            print(f"  {'placed' if cycle.placed else cycle.reason}, {cycle.duration:.2f} s of simulated time")
        run.robot.put("green can", run.robot.pose("red can"))  # gone from the table
        cycle = run.cycle(2)
        print(f"{cycle.target}: {cycle.reason}, after {cycle.attempts} looks")
