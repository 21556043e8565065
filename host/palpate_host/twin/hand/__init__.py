"""The hand and the object it grasps: the paper's Eqs. (4)-(8), and the same hand in MuJoCo with friction."""
