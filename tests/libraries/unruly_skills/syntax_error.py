class broken(:
