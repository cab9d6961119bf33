"""A library with faults. A comment `# error: code` or `# warning: code` stands in each line that has one."""
