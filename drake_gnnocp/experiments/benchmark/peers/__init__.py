"""The peers: our optimal control problem as others would write it, in CasADi and as a first program in Drake."""
