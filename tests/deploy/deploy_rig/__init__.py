"""Boards to provision: bare Debian in namespaces or in a virtual machine, reached by ssh."""
