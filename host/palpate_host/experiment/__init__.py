"""The paper's experiment (Fig. 20): the same turns under both laws, from several poses, and a report."""
