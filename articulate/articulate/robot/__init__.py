"""Robot arm: limits, kinematics, control stack and gripper, for the engines and the real arm."""
