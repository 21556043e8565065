"""``palpate-host demo``: a whole hand as processes on this machine, watched live, measured and reported."""
