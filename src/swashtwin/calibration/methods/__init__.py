"""Methods that search the interface values: IPINN, Gauss-Newton and others."""
