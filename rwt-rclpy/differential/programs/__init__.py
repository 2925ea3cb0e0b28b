"""Programs of the comparison, one module for each area; each public function is a program."""
