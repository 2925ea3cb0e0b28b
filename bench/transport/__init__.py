"""What each way between processes costs, beside the bare kernel and beside other programs that use it."""
