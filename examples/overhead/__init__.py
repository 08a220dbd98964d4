"""What monitoring costs: the paper's table III again, beside monitors that stand in the middle."""
