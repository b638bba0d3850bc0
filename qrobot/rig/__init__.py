"""Board, servo and bridge put together: as processes from a deployment file, or in lock-step inside one process."""
