"""palpate_host: gathers the fingertips, computes the virtual-frame torques and drives the hand."""
