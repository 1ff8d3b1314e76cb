# lifting
