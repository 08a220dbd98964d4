"""Systems in one process and in virtual time: their code, what their models mean, and runs of them."""
