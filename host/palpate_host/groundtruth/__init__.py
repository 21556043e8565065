"""The object's pose by an external camera: the paper's ground truth (Fig. 18)."""
